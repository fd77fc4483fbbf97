"""A client of the cell that calibrates its machine."""

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

from pkm_core.errors import PkmError
from pkm_interfaces.action import Calibrate
from pkm_nodes.clients.cell_client import ANSWER_TIMEOUT, CellClient


class CalibrateClient(CellClient):
    """Client of a running cell; use it in a ``with`` block. It owns rclpy's default context."""

    def __enter__(self):
        super().__enter__()
        self._calibrate = ActionClient(self._node, Calibrate, 'calibrate')
        return self

    def __exit__(self, *arguments):
        self._calibrate.destroy()
        super().__exit__(*arguments)

    def calibrate(self, request, folder, check, on_feedback):
        """
        Calibrate the machine and return the `Calibrate.Result`, also of a calibration that was not taken up.

        Parameters
        ----------
        request : pkm_core.design.cell_calibration.Request
            Numbers of poses, and the average.
        folder : str
            Of the results, in the folder of the calibration node.
        check : callable
            Raises `PkmError` if a process of the cell has ended.
        on_feedback : callable
            Called with every `Calibrate.Feedback`.

        Raises
        ------
        PkmError
            If the goal is refused or ends before a fit; with the cell's own message.

        """
        goal = Calibrate.Goal(
            session=self._session,
            poses=request.poses,
            verification=request.verification,
            wait=request.wait,
            averaging=request.averaging,
            seed=request.seed,
            folder=folder,
        )
        self._spin_until(self._calibrate.server_is_ready, check, ANSWER_TIMEOUT, 'the cell did not offer calibrate')
        handle = self._send(self._calibrate, goal, 'calibrate', check, on_feedback)
        answer = self._wait_for_result(handle, 'calibrate', check)
        if answer.status != GoalStatus.STATUS_SUCCEEDED and not answer.result.file:
            raise PkmError(answer.result.message)
        return answer.result
