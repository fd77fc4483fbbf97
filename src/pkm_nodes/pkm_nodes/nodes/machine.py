"""
Node `machine`: one simulated mechanism with its motors and the laser in front of it, and the clock of the cell.

The machine is the time base. Tick k carries the encoder samples; it advances when every joint controller has answered
tick k, and not before. An answer to any other tick is counted and never applied. Between cycles simulated time stands
still. A missing answer is waited for `answer_timeout` of wall time, then the machine names who is missing, brakes by
itself and waits for its `reset` service. It does so at once when a STOP event of the running cycle asks for it.
"""

import math
import sys
from time import monotonic

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import UInt32, UInt64
from std_srvs.srv import Trigger

from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine
from pkm_core.plant.plant import Plant
from pkm_interfaces.msg import CycleEvent, EncoderSample
from pkm_nodes.graph import ENVIRONMENTS
from pkm_nodes.messages.conversions import time_of_tick
from pkm_nodes.messages.diagnostics import (
    CYCLE,
    FAULT,
    FAULTED,
    HELD,
    RUNNING,
    STANDING,
    STATE,
    TICK,
    diagnostics,
)
from pkm_nodes.messages.tick_messages import MOTOR_COMMAND
from pkm_nodes.nodes.laser import LaserNode
from pkm_nodes.nodes.linear_motor import LinearMotorNode
from pkm_nodes.parts.cycle_events import CycleEvents, subscribe_events
from pkm_nodes.runtime.node import LAST_VALUE_QOS, TICK_QOS, PkmNode, run

# [ticks] /clock goes out at 100 Hz of simulated time: ROS tools need no more, and every node has to take it
CLOCK_EVERY = 20
# [ticks] the laser tells what it has measured at 100 Hz: one reading of many samples costs little more than of one
LASER_EVERY = 20
# [ticks] the longest safe stop: 0.2 s is far more than the brakes need from full speed
BRAKE_TICKS = 400


class MachineNode(PkmNode):
    """Steps the simulated mechanism in lock-step with the joint controllers and publishes /clock."""

    def __init__(self, **kwargs):
        super().__init__('machine', **kwargs)
        machine = load_machine(self.setting('machine', 'four_dof', 'machine of config/machines, or a YAML file'))
        seed = self.setting('seed', 1, 'seed of everything random in the machine')
        environment = self.setting('environment', 'nominal', ENVIRONMENTS)
        self._answer_timeout = self.setting('answer_timeout', 5.0, '[s, wall] wait for the answers of a tick')
        self._start_timeout = self.setting('start_timeout', 10.0, '[s, wall] wait for the other joints to load a cycle')
        self._wait_for_recorder = self.setting(
            'wait_for_recorder', False, 'start no cycle, and run not far ahead, without a recorder'
        )
        self._window = self.setting(
            'recorder_window', 400, '[ticks] how far ahead of the recorder: no sample can be lost'
        )
        self.check_settings()
        if not 1 <= self._window < TICK_QOS.depth:
            raise ConfigError(
                f'machine: recorder_window is {self._window} ticks; expected 1 to {TICK_QOS.depth - 1}, '
                "less than the recorder's queue holds"
            )

        self._joints = machine.joints
        self._resolution = machine.encoder_resolution
        self._sample_time = machine.sample_time
        self._plant = Plant(machine, seed, environment=environment)
        self._motors = [LinearMotorNode(joint, i, self._on_command) for i, joint in enumerate(self._joints)]
        self._laser = LaserNode(machine, seed, environment)
        self.parts = [*self._motors, self._laser]

        self._tick = 0
        self._laser.zero(self._tick, self._plant.truth)
        self._cycle = 0
        self._index = 0
        self._samples = 0
        self._running = False
        self._fault = ''
        self._volts = [0.0] * len(self._joints)
        self._missing = set()
        self._complaints = {}
        self._stale = dict.fromkeys(self._joints, 0)
        self._loaded = {}
        self._loaded_since = 0.0
        self._recorded_tick = -1  # nothing before the recorder's first word
        self._held = False
        self._waiting_since = 0.0

        self._events = CycleEvents(self, 'machine')
        self._clock_publisher = self.create_publisher(ClockMessage, '/clock', qos_profile_sensor_data)
        self._cycle_publisher = self.create_publisher(UInt32, 'machine/cycle', LAST_VALUE_QOS)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        subscribe_events(self, self._on_event)
        self.on_tick_topic(UInt64, 'recorder/tick', self._on_recorder_tick)
        self.create_service(Trigger, 'machine/reset', self._on_reset)
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.05, self._watch, clock=wall)
        self.create_timer(1.0, self._publish_diagnostics, clock=wall)

    def _on_event(self, event):
        if event.event == CycleEvent.STOP and self._running and event.cycle == self._cycle:
            self._stop_safely(f'{event.source}: {event.message}')
            return
        if event.event != CycleEvent.LOADED or event.source not in self._joints:
            return
        if self._fault:
            reason = f'the machine has stopped: {self._fault}; call the service machine/reset first'
            self._events.publish(CycleEvent.REFUSED, event.cycle, tick=self._tick, message=reason)
            return
        if self._running or event.cycle <= self._cycle:  # a late word on a cycle that has been started
            return
        if any(cycle != event.cycle for cycle, _ in self._loaded.values()):
            self._loaded.clear()
        if not self._loaded:
            self._loaded_since = monotonic()
        self._loaded[event.source] = (event.cycle, event.samples)
        self._start_if_complete()

    def _start_if_complete(self):
        """Start the cycle all joints have loaded, once every reader of the encoders is connected."""
        recorder_missing = self._wait_for_recorder and self._recorded_tick < 0
        if len(self._loaded) < len(self._joints) or recorder_missing or not all(part.is_heard() for part in self.parts):
            return
        lengths = {joint: samples for joint, (_, samples) in self._loaded.items()}
        cycle = self._loaded[self._joints[0]][0]
        self._loaded.clear()
        if len(set(lengths.values())) > 1 or min(lengths.values()) < 1:
            reason = f'the joints loaded cycles of different lengths: {lengths}; all must be equal and at least 1'
            self._events.publish(CycleEvent.REFUSED, cycle, tick=self._tick, message=reason)
            return
        self._cycle, self._index, self._samples = cycle, 0, lengths[self._joints[0]]
        self._plant.start_cycle(cycle)
        self._running = True
        self._cycle_publisher.publish(UInt32(data=cycle))
        self._events.publish(CycleEvent.STARTED, cycle, tick=self._tick, samples=self._samples)
        self._publish_samples(EncoderSample.RUN)

    def _publish_samples(self, mode):
        """Send the encoder samples of this tick and wait for the answers."""
        if self._tick % CLOCK_EVERY == 0:
            self._clock_publisher.publish(ClockMessage(clock=time_of_tick(self._tick, self._sample_time)))
        self._missing.update(range(len(self._joints)))
        self._waiting_since = monotonic()
        for motor, counts in zip(self._motors, self._plant.counts.tolist(), strict=True):
            motor.publish(self._tick, self._cycle, self._index, mode, counts, counts * self._resolution)

    def _on_command(self, joint, data):
        tick, _, voltage, _, _ = MOTOR_COMMAND.unpack(data)
        if not self._running or tick != self._tick or joint not in self._missing:
            self._stale[self._joints[joint]] += 1
            return
        if not math.isfinite(voltage):
            self._complaints[joint] = f'answered with {voltage} V; expected a finite voltage'
            return
        self._volts[joint] = voltage
        self._missing.discard(joint)
        if not self._missing:
            self._advance()

    def _advance(self):
        """All joints have answered: the mechanism moves on by one tick."""
        self._plant.tick(self._volts)
        self._index += 1
        self._count()
        self._complaints.clear()
        if self._plant.fault:
            self._stop_safely(self._plant.fault)
        elif self._index == self._samples:
            self._running = False
            self._laser.publish()
            self._events.publish(CycleEvent.FINISHED, self._cycle, tick=self._tick, samples=self._samples)
        elif self._wait_for_recorder and self._tick - self._recorded_tick > self._window:
            self._held = True
            self._waiting_since = monotonic()
        else:
            self._publish_samples(EncoderSample.RUN)

    def _count(self):
        """The mechanism has moved on by one tick."""
        self._tick += 1
        self._laser.observe(self._tick, self._plant.truth)
        if self._tick % LASER_EVERY == 0:
            self._laser.publish()

    def _on_recorder_tick(self, message):
        if self._recorded_tick < 0:
            self._loaded.clear()  # its trajectories may have been sent before the recorder heard; they come again
        self._recorded_tick = message.data
        if self._held and self._tick - self._recorded_tick <= self._window:
            self._held = False
            self._publish_samples(EncoderSample.RUN)

    def _watch(self):
        """Find out, in wall time, whom the cell is waiting for."""
        if self._loaded and not self._running:
            self._start_if_complete()
        waited = monotonic() - self._waiting_since
        if self._running and waited > self._answer_timeout:
            where = f'tick {self._tick} (cycle {self._cycle}, sample {self._index})'
            if self._held:
                self._stop_safely(
                    f'{where}: the recorder has not confirmed anything after tick {self._recorded_tick} '
                    f'for {waited:.1f} s; it may lag by {self._window} ticks'
                )
            elif self._missing:
                missing = ', '.join(map(self._describe_missing, sorted(self._missing)))
                self._stop_safely(f'{where}: no answer for {waited:.1f} s from {missing}')
        elif self._loaded and monotonic() - self._loaded_since > self._start_timeout:
            cycle = next(iter(self._loaded.values()))[0]
            late = [joint for joint in self._joints if joint not in self._loaded]
            deaf = [part.get_name() for part in self.parts if not part.is_heard()]
            self._loaded.clear()
            reason = f'topics of {deaf} have readers that are not connected after {self._start_timeout} s'
            if self._wait_for_recorder and self._recorded_tick < 0:
                reason = f'the recorder has not reported within {self._start_timeout} s; is it running?'
            if late:
                reason = f'not loaded within {self._start_timeout} s by joint_controller of {late}'
            self._events.publish(CycleEvent.REFUSED, cycle, tick=self._tick, message=f'cycle {cycle}: {reason}')

    def _describe_missing(self, joint):
        """Return in words whose answer is missing: the node by its name where it is not ours."""
        name, nodes = self._joints[joint], self._motors[joint].answering_nodes()
        others = [node for node in nodes if not node.endswith(f'/joint_controller_{name}')]
        remarks = [*others, *filter(None, [self._complaints.get(joint)])]
        return f'joint_controller of {name}' + (f' ({", ".join(remarks)})' if remarks else '')

    def _stop_safely(self, reason):
        """Brake without the controllers, keep publishing what the encoders see, and wait for a reset."""
        self._fault = reason
        self.get_logger().error(f'safe stop: {reason}')
        if not self._missing:  # the samples of this tick have not gone out yet
            self._publish_samples(EncoderSample.SAFE_STOP)
        for _ in self._plant.brake(BRAKE_TICKS):
            self._count()
            self._publish_samples(EncoderSample.SAFE_STOP)
        next(self._plant.brake(1))
        self._count()  # no two samples have the same tick, also not across a reset
        self._laser.publish()
        self._running = self._held = False
        self._missing.clear()
        self._complaints.clear()
        self._events.publish(CycleEvent.FAULT, self._cycle, tick=self._tick, samples=self._index, message=reason)

    def _on_reset(self, _, response):
        if self._running:
            response.message = f'cycle {self._cycle} is running; a reset is for a machine that stands'
            return response
        self._plant.reset()
        self._laser.zero(self._tick, self._plant.truth)
        self._loaded.clear()
        response.success = True
        response.message = f'at home; cleared: {self._fault}' if self._fault else 'at home; there was no fault'
        self._fault = ''
        self._events.publish(CycleEvent.RESET, self._cycle, tick=self._tick)
        return response

    def _publish_diagnostics(self):
        state = FAULTED if self._fault else HELD if self._held else RUNNING if self._running else STANDING
        stale = {f'stale commands {joint}': count for joint, count in self._stale.items()}
        message = diagnostics(
            self,
            DiagnosticStatus.ERROR if self._fault else DiagnosticStatus.OK,
            f'fault: {self._fault}' if self._fault else 'cycle running' if self._running else 'standing',
            {STATE: state, CYCLE: self._cycle, TICK: self._tick, FAULT: self._fault, **stale},
            time_of_tick(self._tick, self._sample_time),
        )
        self._diagnostics.publish(message)


def make_nodes():
    """Return the machine, its motors and the laser: one process, because they share one mechanism."""
    machine = MachineNode()
    return [machine, *machine.parts]


def main(args=None):
    """Run the machine as a process of its own."""
    sys.exit(run(make_nodes, args))
