"""
Node `joint_controller`: one axis; answers every encoder tick with a command and learns after every cycle.

The law is `RobustController` or `ObserverController` of pkm_core, by the parameter `control`; the feedforward of the
next cycle comes from the learning service. The gains or weights are parameters: a change is applied between two ticks
without a jump, and refused if the margins of the loop would be too small. In a cycle of identification an excitation is
added to the voltage; an axis outside its bounds gets no command, and a stop is requested.
"""

import numpy as np

from pkm_core.control.controllers import SINGLE_AXIS, axis_controller, choose_control
from pkm_core.control.feasibility import check_drive, saturation_notice
from pkm_core.control.forces import coupling_voltage
from pkm_core.control.margins import require_margins, require_stable_set
from pkm_core.control.model import load_model
from pkm_core.control.observer_design import ObserverLaw
from pkm_core.errors import ConfigError, PkmError
from pkm_core.identification import IdentificationError
from pkm_core.motion.pieces import rows_from
from pkm_interfaces.msg import CycleEvent, EncoderSample
from pkm_nodes.messages.conversions import learns
from pkm_nodes.messages.tick_messages import ENCODER_SAMPLE, MOTOR_COMMAND
from pkm_nodes.parts.axis_excitation import AxisExcitation
from pkm_nodes.parts.axis_learning import AxisLearning
from pkm_nodes.parts.cycle_controller import CycleController, choose_gains, following_error_limit
from pkm_nodes.parts.cycle_events import CycleEvents
from pkm_nodes.parts.cycle_law import CycleLaw
from pkm_nodes.parts.gain_parameters import GainParameters, flat
from pkm_nodes.parts.loaded_config import LoadedConfig
from pkm_nodes.runtime.node import PkmNode, entry_point


class JointControllerNode(PkmNode):
    """Encoder and joint_trajectory in, command out; one node per joint."""

    def __init__(self, *, name='joint_controller', **kwargs):
        super().__init__(name, **kwargs)
        self._machine, self._chosen, self._loaded_gains = choose_gains(self, *SINGLE_AXIS)
        machine = self._machine
        joint = self.setting('joint', machine.joints[0], f'which joint: one of {list(machine.joints)}')
        self.hardware_id += f', {joint}'
        if joint not in machine.joints:
            raise ConfigError(f'{name}: joint {joint!r}; {machine.name} has {list(machine.joints)}')
        self._joint, self._column, self._model = joint, machine.joints.index(joint), load_model(machine)[joint]
        self._least = {
            # chosen: 6 dB and 30 deg are the usual lower bounds for a loop; the designs have 8.5 dB and 45 deg
            'gain_margin': self.setting('least_gain_margin', 6.0, '[dB] gains that leave less are refused'),
            'phase_margin': self.setting('least_phase_margin', 30.0, '[deg] gains that leave less are refused'),
        }
        self._gains = GainParameters(self, self._loaded_gains[joint], self._check_gains, self._exchange)
        self._limit = following_error_limit(self)
        self.check_settings()
        self._config = LoadedConfig(self, machine, self._chosen)
        self._controller = axis_controller(self._gains.gains, self._model, machine)
        self._feedforward = np.zeros(0)
        self._errors = np.zeros(0)  # [m] of the loaded cycle, one per sample
        self._excitation = AxisExcitation(self, machine, joint)
        self._excited = None  # the `ExcitedAxis` of a cycle of identification
        self._events = CycleEvents(self, joint)
        self._learning = AxisLearning(self, joint, machine, self._events, self._on_learned)
        law = CycleLaw(
            load=self._load,
            reset=self._reset,
            extend=self._extend,
            check=self._check,
            is_busy=self._is_busy,
            learn=self._learn,
            notice=lambda: self._learning.notice,
        )
        self._cycles = CycleController(self, machine, {joint: self._events}, law, self._limit)
        self._cycle, self._send_command = self._cycles.cycle, self._cycles.senders[0]
        self.offer(f'{joint}/reload', self._reload)
        self._encoder = self.on_tick_topic(EncoderSample, f'{joint}/encoder', self._on_sample, size=ENCODER_SAMPLE.size)

    def _check_gains(self, gains):
        where, loop = self.get_fully_qualified_name(), (gains.on(self._model), self._model, self._machine.sample_time)
        require_margins(where, *loop, **self._least)
        if isinstance(gains, ObserverLaw):
            require_stable_set(where, *loop)

    def _exchange(self, gains):
        self._controller.exchange(gains, self._model)
        self._learning.renew()

    def _reload(self):
        """Load model and gains from the configuration again; `PkmError` if the cycle runs or a margin is too small."""
        joint, before = self._joint, self._model
        try:
            if self._cycle.running:
                raise PkmError(f'{joint}: cycle {self._cycle.active} is running; reload when it has ended')
            loaded = self._config.now()
            self._model = load_model(self._machine)[joint]
            gains = choose_control(self._machine, self._chosen)
            if flat(self._gains.gains) == flat(gains[joint]):  # the model may have changed
                self._check_gains(gains[joint])
                self._exchange(gains[joint])
            else:
                self._gains.take(gains[joint])
        except PkmError:
            self._model = before
            raise
        self._loaded_gains = gains
        self._config.replace(loaded)

    # the law, between ticks

    def _reset(self):
        self._controller.reset()
        self._learning.reset()

    def _check(self, message):
        if message.feedforward and self._has_changed():
            raise PkmError(
                f'cycle {message.cycle}: learned feedforward for the gains of the configuration, but they have been '
                f'changed since; set the parameters of {self.get_fully_qualified_name()} back'
            )

    def _has_changed(self):
        """Return whether the gains are no longer those of the configuration."""
        return flat(self._gains.gains) != flat(self._loaded_gains[self._joint])

    def _is_busy(self, message):
        return self._learning.is_under_way() or self._excitation.is_missing(message)

    def _load(self, loaded):
        self._learning.refuse_silence()
        check_drive(self._machine, self._model, loaded.trajectory, self._column)
        axis = [np.ascontiguousarray(values[:, self._column]) for values in loaded.trajectory.derivatives()]
        self._excited = self._excitation.begin(loaded.message, self._model, self._gains.gains, *axis[:3])
        given = loaded.feedforward
        given = None if given is None else np.ascontiguousarray(given[:, self._column])
        self._learning.begin(loaded.message, axis[0], given, forces=self._model.forces is not None)
        self._feedforward = self._learning.feedforward
        self._errors = loaded.errors[:, 0]
        coupling = coupling_voltage(self._machine, loaded.trajectory, self._column)
        self._controller.load(*axis, self._feedforward, coupling)

    def _extend(self, loaded, offset):
        column, piece = self._column, rows_from(loaded.trajectory, offset)
        check_drive(self._machine, self._model, piece, column)
        coupling = coupling_voltage(self._machine, piece, column)

        def put_in_force():
            self._controller.extend(offset, *(rows[:, column] for rows in piece.derivatives()), coupling)
            self._feedforward = np.concatenate([self._feedforward[:offset], np.zeros(len(piece))])
            self._errors = loaded.errors[:, 0]

        return put_in_force

    def _on_learned(self):
        self._cycles.load_if_possible()

    def _learn(self, loaded):
        limited, total = self._controller.saturated, len(self._errors)
        notice = saturation_notice(self._joint, limited, total, self._machine.voltage_limit)
        if notice:
            self._learning.publish_notice(loaded.message.cycle, notice)
        if learns(loaded.message) and isinstance(self._gains.gains, ObserverLaw) and self._has_changed():
            changed = f'{self._joint}: nothing is learned with weights that differ from those of the configuration'
            self._learning.publish_notice(loaded.message.cycle, changed)
        elif learns(loaded.message):
            self._learning.learn(loaded.message, loaded.errors[:, 0].copy(), self._gains.gains)

    # the tick

    def _on_sample(self, data):
        """Answer one encoder tick: the hot path."""
        tick, cycle, index, mode, _, position = ENCODER_SAMPLE.unpack(data)
        # a safe stop: the cycle has ended, and the next one starts as after power-up
        if mode != EncoderSample.RUN and not self._cycles.extended(mode, index):
            return
        if cycle != self._cycle.active:
            return
        try:
            voltage, error = self._controller.update(index, position)
            if self._excited is not None:  # it has bounds of its own
                voltage = self._excited.drive(index, voltage, position)
            elif not -self._limit <= error <= self._limit:
                self._cycles.stop(tick, self._joint, error)
                return
        except IdentificationError as reason:
            self._events.publish(CycleEvent.STOP, cycle, tick=tick, message=str(reason))
            return
        except PkmError as refusal:
            self.get_logger().error(f'{self._encoder.topic_name}: {refusal}; not answered')
            return
        self._cycle.running = True
        self._send_command(MOTOR_COMMAND.pack(tick, cycle, voltage, error, self._feedforward.item(index)))
        self._errors[index] = error
        if index + 1 == len(self._errors):
            self._cycles.finish()


main = entry_point(JointControllerNode)
