"""Goals and service calls of an operator: run, visit, stop, brake, reset, pause, step, pace."""

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from std_srvs.srv import SetBool, Trigger

from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import PlatformPose


class CellButtons:
    """
    Clients of the public actions and services of a cell, in the namespace of `node`.

    Parameters
    ----------
    node : PkmNode
    on_answer : callable
        ``on_answer(text, good=True)`` is called with every answer, and with every step of a goal.

    """

    def __init__(self, node, on_answer):
        self._answer = on_answer
        self._execute = ActionClient(node, ExecuteMotion, 'execute_motion')
        self._cancel = node.create_client(CancelGoal, 'execute_motion/_action/cancel_goal')
        self._machine = {name: node.create_client(Trigger, f'machine/{name}') for name in ('reset', 'stop', 'step')}
        self._pause = node.create_client(SetBool, 'machine/pause')
        self._parameters = node.create_client(SetParameters, 'machine/set_parameters')

    @property
    def offers_pace(self):
        """Whether the machine can pause and step."""
        return self._pause.service_is_ready() and self._machine['step'].service_is_ready()

    def run(self, motion, cycles, law):
        """Send a goal of a named motion."""
        self._send(ExecuteMotion.Goal(motion=motion, cycles=cycles, learning_law=law), f'{motion}, law {law}')

    def visit(self, pose):
        """Send a goal that visits `pose`, {coordinate: value [m, rad]}, from home and back."""
        self._send(ExecuteMotion.Goal(poses=[PlatformPose(**pose)], cycles=1), 'visit')

    def stop(self):
        """Cancel every goal, those of other clients included: an empty request means all."""
        if not self._cancel.service_is_ready():
            self._answer('stop: no trajectory_generator offers execute_motion', good=False)
            return

        def on_answer(future):
            count = len(future.result().goals_canceling)
            self._answer(f'stop: {count} goal(s) end after this cycle' if count else 'stop: no goal is running')

        self._cancel.call_async(CancelGoal.Request()).add_done_callback(on_answer)

    def brake(self):
        """Brake the machine in the running cycle."""
        self._call(self._machine['stop'], Trigger.Request(), 'brake', 'machine/stop')

    def reset(self):
        """End a fault: the machine stands at home afterwards."""
        self._call(self._machine['reset'], Trigger.Request(), 'reset', 'machine/reset')

    def step(self):
        """Run one tick of a paused machine."""
        self._call(self._machine['step'], Trigger.Request(), 'step', 'machine/step')

    def pause(self, paused):
        """Pause the machine between two ticks, or let it continue."""
        self._call(self._pause, SetBool.Request(data=paused), 'pause' if paused else 'continue', 'machine/pause')

    def pace(self, factor):
        """Set the pace: simulated time per wall time; 0 is as fast as possible."""
        if not self._parameters.service_is_ready():
            self._answer('pace: no machine offers machine/set_parameters', good=False)
            return
        value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float(factor))

        def on_answer(future):
            result = future.result().results[0]
            words = f'{factor:g} x real time' if factor else 'as fast as possible'
            self._answer(f'pace: {words if result.successful else result.reason}', good=result.successful)

        request = SetParameters.Request(parameters=[Parameter(name='pace', value=value)])
        self._parameters.call_async(request).add_done_callback(on_answer)

    def _send(self, goal, name):
        if not self._execute.server_is_ready():
            self._answer(f'{name}: no trajectory_generator offers execute_motion', good=False)
            return
        self._answer(f'{name}: sent')

        def on_feedback(message):
            self._answer(f'{name}: cycle {message.feedback.cycle} of {goal.cycles} done')

        def on_result(future):
            answer = future.result()
            good = answer.status in (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED)
            self._answer(f'{name}: {answer.result.message or "done"}', good=good)

        sent = self._execute.send_goal_async(goal, feedback_callback=on_feedback)
        sent.add_done_callback(lambda future: future.result().get_result_async().add_done_callback(on_result))

    def _call(self, client, request, name, service):
        """Call a service of the machine and show its answer."""
        if not client.service_is_ready():
            self._answer(f'{name}: no machine offers {service}', good=False)
            return
        answer = client.call_async(request)
        answer.add_done_callback(
            lambda f: self._answer(f'{name}: {f.result().message or "done"}', good=f.result().success)
        )
