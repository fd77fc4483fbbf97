"""
Node `machine`: one simulated mechanism with its motors and laser, and the clock of the cell.

The machine is the time base. Tick k carries the encoder samples; the machine advances when every joint controller has
answered tick k, and not before; with a pace, not before its wall time either. An answer to any other tick is counted
and never applied. Between cycles simulated time stands still, unless `time` is continuous. When an answer is missing
for `answer_timeout` of wall time, the machine reports the joints without an answer, brakes without the controllers and
waits for its `reset` service. A STOP event of the running cycle stops it at once.

The node converts messages and performs actions. `TickBarrier` decides which answers count, `CycleRun` what happens to
a cycle.
"""

from time import monotonic

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from std_msgs.msg import UInt32, UInt64
from std_srvs.srv import Trigger

from pkm_core.errors import ConfigError
from pkm_core.machines.geometry import load_geometry
from pkm_core.machines.identity import Specimen
from pkm_core.plant.plant import Plant
from pkm_core.servo.cycle_actions import (
    AwaitTurn,
    Extend,
    Finish,
    GoHome,
    Refuse,
    RefuseReset,
    SendExtended,
    SendSamples,
    Start,
    StopSafely,
)
from pkm_core.servo.cycle_run import SEND_SAMPLES, CycleRun, CycleState
from pkm_core.servo.tick_barrier import TickBarrier
from pkm_interfaces.msg import CycleEvent, EncoderSample
from pkm_nodes.graph import ENVIRONMENTS
from pkm_nodes.messages.diagnostics import CYCLE, FAULT, FOREIGN, OTHERS, REFUSED, STATE, TICK, diagnostics
from pkm_nodes.messages.tick_messages import MOTOR_COMMAND, UINT64
from pkm_nodes.nodes.laser import LaserNode
from pkm_nodes.nodes.linear_motor import LinearMotorNode
from pkm_nodes.parts.cell_lock import CellLock
from pkm_nodes.parts.cycle_events import CycleEvents, subscribe_events
from pkm_nodes.parts.intruders import Intruders, results_of
from pkm_nodes.parts.loaded_config import declare_truth_hash
from pkm_nodes.parts.machine_time import MachineTime
from pkm_nodes.parts.node_geometry import NodeGeometry
from pkm_nodes.parts.pace_control import PaceControl
from pkm_nodes.parts.rate import TickRates
from pkm_nodes.parts.standing_reports import StandingReports
from pkm_nodes.runtime.node import LAST_VALUE_QOS, TICK_QOS, PkmNode, entry_point

# [ticks] /clock is published at 100 Hz of simulated time: ROS tools need no more, and every node receives it
CLOCK_EVERY = 20
# [ticks] laser samples are read at 100 Hz: reading many samples costs little more than reading one
LASER_EVERY = 20
# [ticks] duration of a safe stop: 0.2 s is several times what the brakes need from full speed
BRAKE_TICKS = 400

unpack_command = MOTOR_COMMAND.unpack  # looked up once, not per command


class MachineNode(PkmNode):
    """Steps the simulated mechanism in lock-step with the joint controllers and publishes /clock."""

    def __init__(self, **kwargs):
        super().__init__('machine', **kwargs)
        geometry = load_geometry(self.machine_setting())
        machine = geometry.machine
        self._timing = PaceControl(self, machine.sample_time)
        self._time = MachineTime(self, machine)
        seed = self.setting('seed', 1, 'seed of everything random in the machine')
        environment = self.setting('environment', 'nominal', ENVIRONMENTS)
        answer_timeout = self.setting('answer_timeout', 5.0, '[s, wall] wait for the answers of a tick')
        start_timeout = self.setting('start_timeout', 10.0, '[s, wall] wait for the other joints to load a cycle')
        wait_for_recorder = self.setting(
            'wait_for_recorder', False, 'start no cycle without a recorder, and stay within its window'
        )
        window = self.setting(
            'recorder_window', 400, '[ticks] allowed distance to the last recorded tick: no sample can be lost'
        )
        self.check_settings()
        if not 1 <= window < TICK_QOS.depth:
            raise ConfigError(
                f'machine: recorder_window is {window} ticks; expected 1 to {TICK_QOS.depth - 1}, '
                "less than the recorder's queue holds"
            )

        self._joints = machine.joints
        self._resolution = machine.encoder_resolution
        self._plant = Plant(machine, seed, environment=environment)
        self.hardware_id = str(Specimen.simulated(machine.name, seed, environment))
        declare_truth_hash(self, machine)
        self._lock = CellLock(self.get_namespace(), self.get_fully_qualified_name(), self.session)
        self._motors = [LinearMotorNode(joint, i, self._on_command) for i, joint in enumerate(self._joints)]
        self._laser = LaserNode(machine, seed, environment)
        self.parts = [*self._motors, self._laser]
        self._barrier = TickBarrier(len(self._joints), answer_timeout)
        window = window if wait_for_recorder else None
        self._run = CycleRun(self._joints, start_timeout, answer_timeout, self._timing.pace, window)
        self._rates = TickRates(self._barrier)
        self._laser.zero(self._barrier.tick, self._plant.truth)

        # no length is used here; a file of another specimen is refused
        NodeGeometry(self, geometry, check=lambda other: other.check_specimen(seed, environment))
        self._events = CycleEvents(self, 'machine')
        self._cycle_publisher = self.create_publisher(UInt32, 'machine/cycle', LAST_VALUE_QOS)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', LAST_VALUE_QOS)
        used = CycleEvent.STOP, CycleEvent.ANNOUNCED, CycleEvent.LOADED
        events = subscribe_events(self, self._on_event, self._joints, kinds=used)
        self.on_tick_topic(UInt64, 'recorder/tick', self._on_recorder_tick, size=UINT64.size)
        taken = [*self.tick_subscriptions, *(sub for motor in self._motors for sub in motor.tick_subscriptions)]
        others = [*(f'{joint}/encoder' for joint in self._joints), 'machine/cycle', 'pose_trajectory']
        self._intruders = Intruders(self, taken, events, others, results_of(self._joints))
        self.create_service(Trigger, 'machine/reset', self._on_reset)
        self.offer('machine/stop', self._on_stop)
        self._timing.serve(self._run, self._barrier, self._perform)
        self._time.serve(self._run, self._barrier, self._timing.pace)
        self.create_timer(0.05, self._watch, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._standing = StandingReports(self, machine, self._look_at_rest, self._publish_diagnostics)

    def _on_command(self, joint, data):
        tick, _, voltage, _, _ = unpack_command(data)
        if self._barrier.answer(joint, tick, voltage):
            self._advance()

    def _advance(self):
        """Move the mechanism by one tick; all joints have answered."""
        self._plant.tick(self._barrier.volts)
        tick, now = self._count(), monotonic()
        actions = self._run.advanced(tick, now, self._plant.fault)
        if actions is SEND_SAMPLES:
            self._await_answers(now)
        else:
            self._perform(actions)

    def _on_event(self, event):
        if event.event == CycleEvent.STOP:
            self._perform(self._run.stop_requested(event.cycle, f'{event.source}: {event.message}'))
        elif event.event == CycleEvent.ANNOUNCED:
            self._run.announced(event.cycle)
            self._look()
        elif event.event == CycleEvent.LOADED:
            self._perform(self._run.loaded(event.source, event.cycle, event.samples, monotonic(), event.hold))
            self._look()

    def _on_recorder_tick(self, data):
        self._perform(self._run.recorded(*UINT64.unpack(data), self._barrier.tick, monotonic()))

    def _watch(self):
        """Check every wait against its timeout, in wall time."""
        now = monotonic()
        self._barrier.look(now)
        if missing := self._barrier.overdue(now):
            described = ', '.join(map(self._describe_missing, missing))
            self._perform(self._run.unanswered(self._barrier.tick, self._barrier.waited(now), described))
        else:
            self._look()

    def _look(self):
        unconnected, intruders = [], ''
        if self._run.state is CycleState.LOADED:
            unconnected = [part.get_name() for part in self.parts if not part.is_heard()]
        if self._run.is_loading:
            intruders = self._intruders.find()
        self._perform(self._run.look(monotonic(), self._barrier.tick, unconnected, intruders))

    def _perform(self, actions):
        for action in actions:
            match action:
                case SendSamples():
                    self._await_answers(monotonic())
                case SendExtended():
                    self._await_answers(monotonic(), EncoderSample.EXTENDED)
                case AwaitTurn():
                    self._timing.await_turn()
                case Start(cycle, samples, hold):
                    self._time.leave_rest(self._laser)
                    self._plant.start_cycle(cycle)
                    self._cycle_publisher.publish(UInt32(data=cycle))
                    self._publish_event(CycleEvent.STARTED, cycle, samples=samples, hold=hold)
                case Extend(cycle, samples):
                    self._publish_event(CycleEvent.EXTENDED, cycle, samples=samples)
                case Finish(cycle, samples):
                    self._laser.publish()
                    self._standing.publish()
                    self._report_intruders()
                    self._publish_event(CycleEvent.FINISHED, cycle, samples=samples)
                    if self._timing.pace.factor:
                        self._publish_diagnostics()
                case Refuse(cycle, reason):
                    self._publish_event(CycleEvent.REFUSED, cycle, message=reason)
                case StopSafely(cycle, samples, reason):
                    self._stop_safely(reason)
                    self._standing.publish()
                    self._report_intruders()
                    self._publish_event(CycleEvent.FAULT, cycle, samples=samples, message=reason)

    def _look_at_rest(self):
        """Return (last cycle, tick of the simulated time, counts) between cycles, None in a cycle."""
        return None if self._run.is_running else (self._run.cycle, self._time.tick, self._plant.counts)

    def _report_intruders(self):
        """Publish a NOTICE if there are publishers whose messages are dropped, once per cycle for each of them."""
        if notice := self._intruders.news(self._run.cycle):
            self.get_logger().warning(notice)
            self._publish_event(CycleEvent.NOTICE, self._run.cycle, message=notice)

    def _publish_event(self, event, cycle, **fields):
        self._events.publish(event, cycle, tick=self._barrier.tick, **fields)

    def _await_answers(self, now, mode=EncoderSample.RUN):
        """Send the encoder samples of this tick to the joint controllers."""
        self._barrier.open(now)
        self._publish_samples(mode)

    def _publish_samples(self, mode):
        tick, cycle, index = self._barrier.tick, self._run.cycle, self._run.index
        if tick % CLOCK_EVERY == 0:
            self._time.publish(tick)
        for motor, counts in zip(self._motors, self._plant.counts.tolist(), strict=True):
            motor.publish(tick, cycle, index, mode, counts, counts * self._resolution)

    def _count(self):
        """Count a tick of the mechanism, let the laser measure and return the number of the next tick."""
        tick = self._barrier.next_tick()
        self._laser.observe(tick, self._plant.truth)
        if tick % LASER_EVERY == 0:
            self._laser.publish()
        return tick

    def _describe_missing(self, joint):
        """Return the controller of a joint without an answer; foreign nodes on its topic are named."""
        name, nodes = self._joints[joint], self._motors[joint].answering_nodes()
        others = [node for node in nodes if not node.endswith(f'/joint_controller_{name}')]
        remarks = [*others, *filter(None, [self._barrier.complaints.get(joint)])]
        return f'joint_controller of {name}' + (f' ({", ".join(remarks)})' if remarks else '')

    def _stop_safely(self, reason):
        """Brake without the controllers and publish the encoder samples of every tick until standstill."""
        self.get_logger().error(f'safe stop: {reason}')
        self._timing.pace.end(self._barrier.tick, monotonic())
        if not self._barrier.is_open:  # the samples of this tick have not been sent yet
            self._publish_samples(EncoderSample.SAFE_STOP)
        self._barrier.close()
        for _ in self._plant.brake(BRAKE_TICKS):
            self._count()
            self._publish_samples(EncoderSample.SAFE_STOP)
        next(self._plant.brake(1))
        self._count()  # no two samples have the same tick, even across a reset
        self._laser.publish()

    def _on_stop(self):
        """Brake at once, or start no further cycle; return what was stopped."""
        before = self._run.fault
        self._perform(self._run.halt('stopped by the service machine/stop'))
        what = f'had stopped already: {before}' if before else f'was stopped at tick {self._barrier.tick}'
        return f'the machine {what}; it waits for machine/reset'

    def _on_reset(self, _, response):
        for action in self._run.reset():
            match action:
                case GoHome(cycle, message):
                    self._plant.reset()
                    self._laser.zero(self._barrier.tick, self._plant.truth)
                    self._standing.publish()
                    self._publish_event(CycleEvent.RESET, cycle)
                    response.success, response.message = True, message
                case RefuseReset(message):
                    response.message = message
        return response

    def destroy_node(self):
        """Let another machine have the namespace; the lock ends with the process anyway."""
        self._lock.release()
        super().destroy_node()

    def _publish_diagnostics(self):
        if self._run.is_running:
            self._intruders.look()
            self._report_intruders()
        fault, tick = self._run.fault, self._barrier.tick
        stale = zip(self._joints, self._barrier.stale, strict=True)
        refused = sum(part.refused_messages() for part in (self, *self._motors))
        foreign, others = self._intruders.foreign, self._intruders.present
        message = diagnostics(
            self,
            DiagnosticStatus.ERROR if fault else DiagnosticStatus.WARN if refused or others else DiagnosticStatus.OK,
            f'fault: {fault}' if fault else others or self._timing.describe(),
            {
                STATE: self._run.state.value,
                CYCLE: self._run.cycle,
                TICK: tick,
                FAULT: fault,
                REFUSED: refused,
                FOREIGN: foreign,
                OTHERS: others,
                **self._rates.values(),
                **{f'stale commands {joint}': count for joint, count in stale},
                **self._timing.values(),
            },
            self._time.now(),
        )
        self._diagnostics.publish(message)


main = entry_point(MachineNode)
