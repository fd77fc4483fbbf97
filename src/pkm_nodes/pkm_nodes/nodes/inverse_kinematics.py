"""
Node `inverse_kinematics`: pose_trajectory in, joint_trajectory out, once per cycle, position to jerk.

With the learning target `tool` the correction of node `tool_learning` is added to the cycles that are learned.
"""

from pkm_core.errors import PkmError
from pkm_core.machines.geometry import load_geometry
from pkm_core.motion.trajectory import to_joints
from pkm_interfaces.msg import CycleEvent
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage
from pkm_nodes.graph import learning_target
from pkm_nodes.messages.conversions import (
    feedforward_from_msg,
    is_identification,
    learns,
    trajectory_from_msg,
    trajectory_to_msg,
)
from pkm_nodes.parts.cycle_events import CycleEvents
from pkm_nodes.parts.node_geometry import NodeGeometry
from pkm_nodes.parts.one_source import subscribe_one
from pkm_nodes.parts.reference_correction import ReferenceCorrection
from pkm_nodes.runtime.node import CYCLE_QOS, PkmNode, entry_point


class InverseKinematicsNode(PkmNode):
    """Maps every pose trajectory to the joints of its machine, or refuses it with a REFUSED event."""

    def __init__(self, **kwargs):
        super().__init__('inverse_kinematics', **kwargs)
        geometry = load_geometry(self.machine_setting())
        at_tool = learning_target(self) == 'tool'
        self.check_settings()
        self._geometry = NodeGeometry(self, geometry)
        self._events = CycleEvents(self, 'inverse_kinematics')
        self._correction = ReferenceCorrection(self, self._geometry, self._events) if at_tool else None
        self._publisher = self.create_publisher(SampledTrajectoryMessage, 'joint_trajectory', CYCLE_QOS)
        self._source = subscribe_one(self, SampledTrajectoryMessage, 'pose_trajectory', self._on_poses, CYCLE_QOS)

    def _on_poses(self, message):
        if is_identification(message):  # planned in joints: its sender publishes the joint_trajectory
            return
        machine, geometry = self._geometry.machine, self._geometry.geometry.digest
        try:
            self._geometry.refuse_another(message)
            poses = trajectory_from_msg(message, coordinates=machine.coordinates, sample_time=machine.sample_time)
            joints = to_joints(machine, poses)
            feedforward = feedforward_from_msg(message, joints.position.shape)
        except PkmError as error:
            reason = f'{error}{self._source.remark()}'
            self.get_logger().error(f'pose_trajectory refused: {reason}')
            # a refused piece of a jog ends it at rest
            event = CycleEvent.NOTICE if message.offset else CycleEvent.REFUSED
            self._events.publish(event, message.cycle, message=reason)
            return

        def send(trajectory, planned=''):
            self._publisher.publish(
                trajectory_to_msg(
                    trajectory,
                    cycle=message.cycle,
                    motion=message.motion,
                    learning_law=message.learning_law,
                    feedforward=feedforward,
                    geometry=geometry,
                    planned=planned,
                    stay=message.stay,
                    offset=message.offset,
                    hold=message.hold,
                )
            )

        if self._correction is not None and learns(message):
            self._correction.add(message.cycle, joints, send)
        else:
            send(joints)


main = entry_point(InverseKinematicsNode)
