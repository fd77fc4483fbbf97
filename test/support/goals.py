"""What stands around the trajectory generator in tests: who sends it goals, and the cell that runs its cycles."""

from rclpy.action import ActionClient

from pkm_core.machines import load_machine
from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import CycleEvent, CycleMetrics, PlatformPose, SampledTrajectory

JOINTS = ('d1', 'd3', 'd5', 'd7')
MOTION = 'four_dof_70ms'


class Goals:
    """Sends goals and takes their results."""

    def __init__(self, graph):
        self._graph = graph
        self._client = ActionClient(graph.node, ExecuteMotion, 'execute_motion')
        self.feedback = []

    def send(self, **goal):
        """Return the handle of a goal that has been taken."""
        self._graph.spin_until(self._client.server_is_ready, 'the action server')
        sent = self._client.send_goal_async(
            ExecuteMotion.Goal(**{'cycles': 1} | goal), lambda message: self.feedback.append(message.feedback)
        )
        self._graph.spin_until(sent.done, 'the acceptance of the goal')
        return sent.result()

    def result(self, handle):
        """Return (status, result) of a goal when it has ended."""
        future = handle.get_result_async()
        self._graph.spin_until(future.done, 'the result of the goal')
        return future.result().status, future.result().result

    def close(self):
        self._client.destroy()


class CellStandIn:
    """Everything behind pose_trajectory, as far as the trajectory generator sees it."""

    def __init__(self, graph):
        self._graph = graph
        self.trajectories = graph.listen(SampledTrajectory, 'pose_trajectory')
        self._events = graph.publisher(CycleEvent, 'cycle_events')
        self._metrics = {joint: graph.publisher(CycleMetrics, f'{joint}/cycle_metrics') for joint in JOINTS}

    def tell(self, event, cycle, **fields):
        source = 'recorder' if event == CycleEvent.RECORDED else 'machine'
        self._events.publish(CycleEvent(event=event, cycle=cycle, source=source, **fields))

    def start(self, cycle):
        """Wait for the trajectory of `cycle`, start it and return the trajectory."""
        self._graph.spin_until(lambda: cycle in [t.cycle for t in self.trajectories], f'trajectory {cycle}')
        trajectory = next(t for t in self.trajectories if t.cycle == cycle)
        self.tell(CycleEvent.STARTED, cycle, hold=trajectory.hold)
        return trajectory

    def finish(self, cycle, errors=(1e-6, 2e-6, 3e-6, 4e-6)):
        for joint, error in zip(JOINTS, errors, strict=False):
            self._metrics[joint].publish(CycleMetrics(cycle=cycle, joint=joint, max_dynamic_error=error))
        self.tell(CycleEvent.FINISHED, cycle)

    def run(self, cycle):
        trajectory = self.start(cycle)
        self.finish(cycle)
        return trajectory


def pose_at(joint_positions):
    x, y, z, phi = load_machine('four_dof').forward(joint_positions)
    return PlatformPose(x=x, y=y, z=z, phi=phi)


NEAR_HOME = pose_at([0.0815, 0.1415, 0.1375, 0.0815])
