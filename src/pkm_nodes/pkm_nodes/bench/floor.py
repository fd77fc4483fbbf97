"""
The floor: cost of the messages of the servo tick in the middleware, without any work on their content.

One process with the topics of the tick, as many subscriptions per topic as in the composed cell, and messages of the
same size. Every tick publishes one encoder sample per axis, takes all of them, publishes one command per axis, takes
all of them. The messages are created beforehand: as message objects, or as bytes, the minimum in Python.
"""

from itertools import chain
from time import perf_counter, process_time

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.serialization import serialize_message

from pkm_interfaces.msg import EncoderSample, MotorCommand
from pkm_nodes.runtime.node import TICK_QOS

# [s, wall] publishers and subscriptions of one process connect at once; the rest is margin
_CONNECTED = 10.0
_SECOND = 1_000_000_000  # ns


class Floor:
    """
    The floor of a cell.

    Parameters
    ----------
    axes : int
        Number of axes of the machine.
    readers : dict
        Number of subscriptions of each 'encoder' and each 'command' topic.
    raw : bool
        Whether messages are bytes instead of message objects.

    """

    def __init__(self, axes, readers, *, raw):
        rclpy.init()
        self._node = Node('floor')
        self._raw = raw
        self._publishers, self._subscriptions = {}, {}
        for kind, message_type in (('encoder', EncoderSample), ('command', MotorCommand)):
            topics = [f'floor/axis{axis}/{kind}' for axis in range(axes)]
            self._publishers[kind] = [self._node.create_publisher(message_type, topic, TICK_QOS) for topic in topics]
            self._subscriptions[kind] = [
                self._node.create_subscription(message_type, topic, lambda _: None, TICK_QOS, raw=raw)
                for topic in topics
                for _ in range(readers[kind])
            ]
        deadline = perf_counter() + _CONNECTED
        while any(p.get_subscription_count() < readers[k] for k, ps in self._publishers.items() for p in ps):
            if perf_counter() > deadline:
                raise TimeoutError(f'floor: not connected within {_CONNECTED:.0f} s')

    def turn(self, ticks):
        """Return {'ticks_per_second', 'cpu_us_per_tick'} over `ticks` ticks."""
        raw, subscriptions = self._raw, list(chain(*self._subscriptions.values()))
        handles = [subscription.handle for subscription in subscriptions]
        take = {s.handle.pointer: (s.handle.take_message, s.msg_type) for s in subscriptions}
        wait_set = _rclpy.WaitSet(len(handles), 0, 0, 0, 0, 0, rclpy.get_default_context().handle)
        steps = [self._step(kind) for kind in ('encoder', 'command')]
        begin, processor_begin = perf_counter(), process_time()
        for _ in range(ticks):
            for publishers, message, answers in steps:
                for publish in publishers:
                    publish(message)
                missing = answers
                while missing:
                    wait_set.clear_entities()
                    for handle in handles:
                        wait_set.add_subscription(handle)
                    wait_set.wait(_SECOND)
                    for pointer in wait_set.get_ready_entities('subscription'):
                        take_message, message_type = take[pointer]
                        if take_message(message_type, raw) is not None:
                            missing -= 1
        seconds, processor = perf_counter() - begin, process_time() - processor_begin
        return {'ticks_per_second': ticks / seconds, 'cpu_us_per_tick': 1e6 * processor / ticks}

    def _step(self, kind):
        """Return the publish functions of `kind`, one per topic, the message, and the number of its subscriptions."""
        publishers = [publisher.handle for publisher in self._publishers[kind]]
        message = self._publishers[kind][0].msg_type()
        if self._raw:
            publish, message = [handle.publish_raw for handle in publishers], serialize_message(message)
        else:
            publish = [handle.publish for handle in publishers]
        return publish, message, len(self._subscriptions[kind])

    def close(self):
        """Destroy the node."""
        self._node.destroy_node()
        rclpy.try_shutdown()
