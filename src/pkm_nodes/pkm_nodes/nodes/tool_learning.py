"""
Node `tool_learning`: laser and errors of one cycle in, joint_correction of the next cycle out.

The law is `ToolLearning` of pkm_core. The correction of a cycle is published when its pose_trajectory arrives and the
measurements of the cycle before are complete; inverse_kinematics adds it to the joint_trajectory. Without the laser, or
without the errors of a joint, the correction is kept and a NOTICE event is published: only the joints learn.
"""

from dataclasses import replace
from functools import partial
from struct import Struct
from time import monotonic

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.control.controllers import choose_control
from pkm_core.errors import PkmError
from pkm_core.learning import make_law
from pkm_core.learning.tool import ToolLearning, make_tool_law
from pkm_core.learning.tool_cycles import ToolCycles
from pkm_core.machines.geometry import load_geometry
from pkm_core.motion.trajectory import DERIVATIVES, to_joints
from pkm_core.recording.block import rows
from pkm_interfaces.msg import CycleError, CycleEvent, LaserSample
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage
from pkm_nodes.messages.conversions import learns, trajectory_from_msg, trajectory_to_msg
from pkm_nodes.parts.cycle_events import CycleEvents, subscribe_events
from pkm_nodes.parts.node_geometry import NodeGeometry
from pkm_nodes.parts.one_source import subscribe_joint_trajectory, subscribe_one
from pkm_nodes.runtime.groups import PatientGroup
from pkm_nodes.runtime.node import CYCLE_QOS, TICK_QOS, PkmNode, entry_point
from pkm_nodes.runtime.patient_subscription import PatientSubscription

# [s, wall] wait for the measurements of a cycle after its successor was planned, and once they have been missing
PATIENCE, IMPATIENCE = 2.0, 0.2
# [s, wall] period of the looks at that wait
_LOOK = 0.02
# [s, wall] period of the looks at the publishers of the laser: the first one is known before others come
_LOOK_FOR_LASER = 1.0


class ToolLearningNode(PkmNode):
    """Learns the correction of one motion after the other."""

    def __init__(self, **kwargs):
        super().__init__('tool_learning', **kwargs)
        geometry = load_geometry(self.machine_setting(), self.configuration_setting())
        machine = geometry.machine
        self._chosen = self.control_setting()
        self._file = self.setting('tool_law', 'laser', 'law: a file of config/learning/tool, or a YAML file')
        self.check_settings()
        self._geometry = NodeGeometry(self, geometry, self._restart)
        self._gains = choose_control(machine, self._chosen)
        self._cycles = ToolCycles(machine)
        self._motion = None  # (name, law, poses) that is learned
        self._learning = None  # its `ToolLearning`, None if the law is refused
        self._nothing = None  # its correction then, zero
        self._correction = None  # message of its last correction
        self._next = None  # cycle whose correction is due
        self._until = 0.0
        self._events = CycleEvents(self, 'tool_learning')
        self._publisher = self.create_publisher(SampledTrajectoryMessage, 'joint_correction', CYCLE_QOS)
        used = CycleEvent.FINISHED, CycleEvent.FAULT, CycleEvent.REFUSED
        subscribe_events(self, self._on_event, kinds=used)
        subscribe_one(self, SampledTrajectoryMessage, 'pose_trajectory', self._on_poses, CYCLE_QOS)
        subscribe_joint_trajectory(self, self._on_joints)
        for joint in machine.joints:
            subscribe_one(self, CycleError, f'{joint}/cycle_error', self._on_error, CYCLE_QOS)
        numbers = Struct(f'<4xdI4x{len(machine.coordinates)}d')  # header, time, length, padding, displacement
        # samples wait while ticks flow: they are needed after the cycle, and the tick is not to be slowed down
        take, group = partial(self._on_samples, numbers), PatientGroup(self._look)
        self._laser = PatientSubscription(self, LaserSample, 'laser', take, TICK_QOS, group)
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_FOR_LASER, self._laser.look, clock=wall)
        self._timer = self.create_timer(_LOOK, self._look, clock=wall)
        self._timer.cancel()
        self.offer('tool_learning/reload', self._reload)

    def _restart(self):
        """Begin the next cycle with the planned reference: the geometry has been exchanged."""
        self._motion = None

    def _reload(self):
        """Read the gains of the configuration again; the next cycle begins with the planned reference."""
        self._gains = choose_control(self._geometry.machine, self._chosen)
        self._restart()

    # measurements

    def _on_samples(self, numbers, data):
        """Take one serialized sample, or several; those of another size are not samples of this machine."""
        for row in rows(data):
            if len(row) == numbers.size:
                time, _, *displacement = numbers.unpack(row.tobytes())
                self._cycles.sample((time, *displacement))

    def _on_error(self, message):
        self._cycles.error(message.cycle, message.joint, message.error)
        self._look()

    def _on_joints(self, message):
        try:
            machine = self._geometry.machine
            joints = trajectory_from_msg(message, coordinates=machine.joints, sample_time=machine.sample_time)
        except PkmError:  # refused by the controllers
            return
        self._cycles.reference(message.cycle, joints.position)

    def _on_event(self, event):
        if event.event == CycleEvent.FINISHED:
            self._cycles.finished(event.cycle, event.tick, event.samples)
        elif event.event in (CycleEvent.FAULT, CycleEvent.REFUSED):
            self._cycles.failed(event.cycle)
        self._look()

    # the next correction

    def _on_poses(self, message):
        """Begin the correction of a cycle, or send it again."""
        if not learns(message):
            return
        motion = message.motion, message.learning_law, message.position.tobytes()
        if motion != self._motion:
            try:
                self._geometry.refuse_another(message)
                self._begin(message)
            except PkmError as error:  # inverse_kinematics refuses these poses
                self.get_logger().error(f'pose_trajectory of cycle {message.cycle}: {error}')
                return
            self._motion, self._correction = motion, None
        if self._correction is not None and self._correction.cycle == message.cycle:
            self._publisher.publish(self._correction)
            return
        if self._next != message.cycle:
            self._next = message.cycle
            self._until = monotonic() + (IMPATIENCE if self._learning and self._learning.is_held else PATIENCE)
            self._timer.reset()
        self._look()

    def _begin(self, message):
        """Make the law for a motion, with its convergence test; a law that is refused learns nothing."""
        machine = self._geometry.machine
        poses = trajectory_from_msg(message, coordinates=machine.coordinates, sample_time=machine.sample_time)
        joints = to_joints(machine, poses)
        self._nothing = replace(joints, **{name: np.zeros_like(joints.position) for name in DERIVATIVES})
        try:
            law = make_law(message.learning_law, machine, self._gains)
            law = make_tool_law(machine, self._gains, law, poses, joints, self._file)
        except PkmError as refusal:
            self._learning = None
            self._notice(message.cycle, f'learning at the tool: {refusal}; only the joints learn')
        else:
            self._learning = ToolLearning(law)
            self.get_logger().info(law.verdict)

    def _look(self):
        """Publish the due correction if everything it needs is there, or the wait for it is over."""
        if self._next is None or self._waits():
            return
        self._timer.cancel()
        cycle, self._next = self._next, None
        if self._correction is not None and (notice := self._learn(self._correction.cycle)):
            self._notice(self._correction.cycle, notice)
        motion = self._learning.motion if self._learning else self._nothing
        self._correction = trajectory_to_msg(motion, cycle=cycle, motion=self._motion[0])
        self._publisher.publish(self._correction)

    def _waits(self):
        """Return whether measurements of the last cycle are still to come."""
        if self._correction is None or self._learning is None or monotonic() > self._until:
            return False
        cycle, has_laser = self._correction.cycle, self.count_publishers(self._laser.topic_name) > 0
        return not self._cycles.has_failed(cycle) and bool(self._cycles.missing(cycle, has_laser))

    def _learn(self, cycle):
        """Learn from `cycle` and return a notice, '' if there is none."""
        learning = self._learning
        if learning is None or self._cycles.has_failed(cycle):
            return ''
        if missing := self._cycles.missing(cycle, laser=False):
            return learning.hold(f'{", ".join(missing)} of cycle {cycle}: missing after {PATIENCE:g} s')
        if not self._cycles.has_run(cycle, learning.reference.position):
            return learning.hold('joint_trajectory was not the planned reference with the correction')
        try:
            return learning.after_cycle(*self._cycles.take(cycle))
        except PkmError as reason:
            return learning.hold(str(reason))

    def _notice(self, cycle, notice):
        self.get_logger().warning(f'cycle {cycle}: {notice}')
        self._events.publish(CycleEvent.NOTICE, cycle, message=notice)


main = entry_point(ToolLearningNode)
