"""A client of the cell that also identifies axes and reloads the controllers."""

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from std_srvs.srv import Trigger

from pkm_core.errors import PkmError
from pkm_core.interrupts import held_back
from pkm_interfaces.action import Identify
from pkm_nodes.clients.cell_client import ANSWER_TIMEOUT, CellClient
from pkm_nodes.messages.conversions import experiments_to_msg


class IdentifyClient(CellClient):
    """Client of a running cell; use it in a ``with`` block. It owns rclpy's default context."""

    def _open(self):
        super()._open()
        self._identify = ActionClient(self._node, Identify, 'identify')

    def __exit__(self, *arguments):
        with held_back():
            self._identify.destroy()
            super().__exit__(*arguments)

    def reload(self, joints, check):
        """Make the running nodes load the current configuration files; `PkmError` with all refusals."""
        refusals = []
        for name in (*(f'{joint}/reload' for joint in joints), 'learning/reload', 'trajectory_generator/reload'):
            client = self._node.create_client(Trigger, name)
            self._spin_until(client.service_is_ready, check, ANSWER_TIMEOUT, f'the cell did not offer {name}')
            answer = client.call_async(Trigger.Request())
            self._spin_until(answer.done, check, ANSWER_TIMEOUT, f'{client.srv_name} did not answer')
            self._node.destroy_client(client)
            if not answer.result().success:
                refusals.append(answer.result().message)
        if refusals:
            raise PkmError('; '.join(refusals))

    def identify(self, request, check, on_feedback):
        """
        Run the experiments of `request` and return the `Identify.Result`.

        Parameters
        ----------
        request : pkm_core.identification.plan.Request
            Axes and experiments.
        check : callable
            Raises `PkmError` if a process of the cell has ended.
        on_feedback : callable
            Called with every `Identify.Feedback`.

        Raises
        ------
        PkmError
            If the goal is refused or ends early; with the cell's own message.

        """
        goal = goal_of(request)
        goal.session = self._session
        self._spin_until(self._identify.server_is_ready, check, ANSWER_TIMEOUT, 'the cell did not offer identify')
        handle = self._send(self._identify, goal, 'identify', check, on_feedback)
        answer = self._wait_for_result(handle, 'identify', check)
        if answer.status != GoalStatus.STATUS_SUCCEEDED:
            raise PkmError(answer.result.message)
        return answer.result


def goal_of(request):
    """Return a `pkm_core.identification.plan.Request` as a goal of the action identify."""
    return Identify.Goal(
        joints=list(request.joints),
        kind=experiments_to_msg(request.kind),
        positions=request.positions,
        band=list(request.band),
        voltage=request.voltage,
        jog_speed=request.jog_speed,
        stroke=request.stroke,
    )
