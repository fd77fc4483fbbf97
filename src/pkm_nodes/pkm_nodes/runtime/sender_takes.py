"""Takes messages of a `SenderGroup` with the GID of their publisher, in any executor of rclpy."""

from rclpy.executors import SingleThreadedExecutor

from pkm_nodes.runtime.denials import NONE
from pkm_nodes.runtime.groups import SenderGroup
from pkm_nodes.runtime.queues import Taker

# most messages taken in a turn, so that a burst does not block other entities
_AT_MOST = 1000


class SenderTakes:
    """Part of an executor; it overrides a method that rclpy 7.1 calls for every ready subscription."""

    _taker = None

    def _take_subscription(self, sub):
        if not isinstance(sub.callback_group, SenderGroup):
            return super()._take_subscription(sub)
        if self._taker is None:
            self._taker = Taker()  # it holds no message between two calls
        found = []
        with sub.handle:
            denials = getattr(sub.callback, 'denials', NONE)
            self._taker.take(sub.handle.pointer, lambda *rows: found.append(rows), _AT_MOST, denials)

        async def call():
            for messages, senders in found:
                for message, sender in zip(messages, senders, strict=True):
                    sub.callback(message.tobytes(), sender.tobytes())

        return call


class SteppedExecutor(SenderTakes, SingleThreadedExecutor):
    """The executor of rclpy for callers that serve a node step by step."""
