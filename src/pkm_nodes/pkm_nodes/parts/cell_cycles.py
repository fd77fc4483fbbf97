"""Cycles that a node runs on the cell as a client of execute_motion, one bag each: identification, calibration."""

from math import inf
from pathlib import Path

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

from pkm_core.errors import PkmError
from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.parts.cycle_events import CycleEvents, subscribe_events
from pkm_nodes.parts.presence import Presence
from pkm_nodes.parts.waiting import Waiting

# [s, wall] to find the other nodes, and from the end of a cycle to its closed bag
_DISCOVERY = 5.0
_RECORDED = 10.0


class CellCycles:
    """
    The cycles that `node` runs, one after the other.

    Parameters
    ----------
    node : PkmNode
    error : type
        Class of the errors raised, a `PkmError`.

    Attributes
    ----------
    first_tick : int or None
        Of the running cycle, None between cycles.

    """

    def __init__(self, node, error=PkmError):
        self._node, self._error = node, error
        self.first_tick = None
        self._active = False
        self._cycle = 0  # started last
        self._bags = {}  # path by cycle
        self._stop = ''  # reason to brake the next cycle at once
        self._waiting = Waiting(node)
        self._events = CycleEvents(node, node.get_name())
        used = CycleEvent.STARTED, CycleEvent.FINISHED, CycleEvent.FAULT, CycleEvent.RECORDED
        subscribe_events(node, self._on_event, kinds=used)
        self._motion = ActionClient(node, ExecuteMotion, 'execute_motion')

    def until(self, condition, timeout=inf):
        """Return a future that becomes True when `condition()` holds, or False after `timeout` [s, wall]."""
        return self._waiting.until(condition, timeout)

    async def require(self, needed):
        """
        Wait until the cell can run cycles.

        `needed` is {topic: sentence that ends with 'publishes', the reason why it is needed}. The error names every
        topic without a publisher.
        """
        node = self._node

        def missing():
            return [topic for topic in needed if node.count_publishers(node.resolve_topic_name(topic)) == 0]

        if not await self.until(lambda: not missing() and self._motion.server_is_ready(), _DISCOVERY):
            reasons = [f'{needed[topic]} publishes {node.resolve_topic_name(topic)}' for topic in missing()]
            raise self._error('; '.join(reasons) or 'no trajectory_generator offers execute_motion')

    def begin(self):
        """Begin the cycles of a goal."""
        self._active, self._stop = True, ''
        self._bags.clear()

    def end(self):
        """End the cycles of a goal."""
        self._active = False

    async def run(self, goal, name):
        """
        Run the cycle of `goal`, an ExecuteMotion.Goal, and return its bag.

        Raises
        ------
        PkmError
            If the cycle does not succeed, the trajectory_generator leaves, or there is no bag; the text begins with
            `name`.

        """
        before, generator = self._cycle, Presence(self._node, 'execute_motion/_action/status')
        sent = self._motion.send_goal_async(goal)
        ended = None
        if await self._until_done(sent, generator):
            ended = sent.result().get_result_async()
        if ended is None or not await self._until_done(ended, generator):
            raise self._error(f'{name}: the trajectory_generator is gone; start it again')
        answer = ended.result()
        if answer.status != GoalStatus.STATUS_SUCCEEDED:
            raise self._error(f'{name}: {answer.result.message}')
        if not await self.until(lambda: self._cycle > before and self._cycle in self._bags, _RECORDED):
            raise self._error(f'{name}: the recorder has closed no bag within {_RECORDED:g} s')
        return self._bags.pop(self._cycle)

    async def _until_done(self, future, server):
        """Wait for `future`; return False if `server`, a `Presence`, leaves the graph first."""
        await self.until(lambda: future.done() or server.has_ended())
        return future.done()

    def stop(self, reason):
        """Brake the machine at once, or as soon as the next cycle starts; a standing machine ignores it."""
        self._stop = reason
        self._events.publish(CycleEvent.STOP, self._cycle, message=reason)

    def _on_event(self, event):
        if not self._active:
            return
        if event.event == CycleEvent.STARTED:
            self._cycle, self.first_tick = event.cycle, event.tick
            if self._stop:
                self.stop(self._stop)
        elif event.event in (CycleEvent.FINISHED, CycleEvent.FAULT):
            self.first_tick = None
        elif event.event == CycleEvent.RECORDED:
            self._bags[event.cycle] = Path(event.bag)

    def destroy(self):
        """Destroy the action client; `Node.destroy_node` does not."""
        self._motion.destroy()
