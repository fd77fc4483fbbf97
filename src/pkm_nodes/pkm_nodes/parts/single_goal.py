"""One goal of an action at a time, of a node that runs cycles on the cell: identification, calibration."""

from pkm_core.errors import PkmError
from pkm_nodes.runtime.session import require_session


class SingleGoal:
    """
    The running goal of the action `name` of `node`.

    Parameters
    ----------
    node : PkmNode
    name : str
        Of the action, for messages.
    cycles : CellCycles
        The cycles that a goal runs.

    Attributes
    ----------
    handle : ServerGoalHandle or None
        Of the running goal.

    """

    def __init__(self, node, name, cycles):
        self._node, self._name, self._cycles = node, name, cycles
        self.handle = None

    async def run(self, goal_handle, result, work):
        """
        Run ``await work(result)`` for `goal_handle` and return the ended `result`.

        A `PkmError` of `work`, a goal of another session and a goal beside a running one abort the goal: accepted goals
        are ended so because only a result carries a reason.
        """
        result.session = self._node.session
        if self.handle is not None:
            result.message = f'another goal of {self._name} is running; wait for its end or cancel it'
            goal_handle.abort()
            return result
        self.handle = goal_handle
        self._cycles.begin()
        try:
            require_session('goal', goal_handle.request.session, self._node.session)
            await work(result)
        except PkmError as error:
            result.message = str(error)
        finally:
            self.handle = None
            self._cycles.end()
        if goal_handle.is_cancel_requested:
            result.message = result.message or 'cancelled after the last cycle; the machine stands at home'
            goal_handle.canceled()
        elif result.message:
            self._node.get_logger().error(f'{self._name}: {result.message}')
            goal_handle.abort()
        else:
            goal_handle.succeed()
        return result
