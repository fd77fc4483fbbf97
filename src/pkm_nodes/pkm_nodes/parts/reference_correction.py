"""Correction of the joints' reference that is learned at the tool, added to the joint trajectory of each cycle."""

from time import monotonic

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.errors import PkmError
from pkm_core.learning.store import digest_of
from pkm_core.motion.trajectory import added, checked_cycle
from pkm_interfaces.msg import CycleEvent
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage
from pkm_nodes.messages.conversions import trajectory_from_msg
from pkm_nodes.parts.one_source import subscribe_one
from pkm_nodes.runtime.node import CYCLE_QOS

# [s, wall] wait for the correction of a cycle; tool_learning waits at most 2 s for its measurements
_PATIENCE = 6.0
# [s, wall] period of the looks at that wait
_LOOK = 0.1


class ReferenceCorrection:
    """
    Adds the correction of topic joint_correction to joint trajectories.

    Parameters
    ----------
    node : PkmNode
    geometry : NodeGeometry
        Has the machine.
    events : CycleEvents
        For notices.

    """

    def __init__(self, node, geometry, events):
        self._geometry, self._events, self._logger = geometry, events, node.get_logger()
        self._known = (0, None)  # cycle and message of the last correction
        self._waiting = None  # (cycle, planned trajectory, send)
        self._until = 0.0
        self._without = False  # whether the last cycle had none
        subscribe_one(node, SampledTrajectoryMessage, 'joint_correction', self._on_correction, CYCLE_QOS)
        self._timer = node.create_timer(_LOOK, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()

    def add(self, cycle, joints, send):
        """
        Call `send(trajectory, planned)` once the correction of `cycle` is known.

        `joints` is the planned `SampledTrajectory`, `trajectory` the corrected one, and `planned` the digest of
        `joints`. After `_PATIENCE`, or if the correction is refused, `trajectory` is `joints`, with a NOTICE event.
        """
        if self._waiting is None or self._waiting[0] != cycle:
            self._until = monotonic() + _PATIENCE
            self._timer.reset()
        self._waiting = cycle, joints, send
        self._send_if_known()

    def _on_correction(self, message):
        self._known = message.cycle, message
        self._send_if_known()

    def _look(self):
        if self._waiting is not None and monotonic() > self._until:
            self._send(f'no joint_correction for {_PATIENCE:g} s: is tool_learning running?')

    def _send_if_known(self):
        if self._waiting is not None and self._waiting[0] == self._known[0]:
            self._send('')

    def _send(self, reason):
        self._timer.cancel()
        (cycle, joints, send), self._waiting = self._waiting, None
        corrected = joints
        try:
            if reason:
                raise PkmError(reason)
            machine = self._geometry.machine
            correction = trajectory_from_msg(
                self._known[1], coordinates=machine.joints, sample_time=machine.sample_time
            )
            if len(correction) != len(joints):
                raise PkmError(f'joint_correction: {len(correction)} samples; expected {len(joints)}')
            corrected = checked_cycle(machine, added(joints, correction))
        except PkmError as refusal:
            if not self._without:
                notice = f'learning at the tool: {refusal}; the reference is as planned, only the joints learn'
                self._logger.warning(f'cycle {cycle}: {notice}')
                self._events.publish(CycleEvent.NOTICE, cycle, message=notice)
        self._without = corrected is joints
        send(corrected, digest_of(joints))
