"""Messages in the queue of a subscription are taken completely, in order, in blocks of equal size."""

from itertools import chain

import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from pkm_nodes.runtime.node import TICK_QOS
from pkm_nodes.runtime.queues import Taker

LARGE = 100_000  # more than the room for one block


@pytest.fixture
def subscription(graph):
    return graph.node.create_subscription(String, 'text', lambda _: None, TICK_QOS, raw=True)


@pytest.fixture
def send(graph, subscription):
    """Return a function that publishes texts and waits until they are in the queue."""
    publisher = graph.publisher(String, 'text')
    graph.spin_until(lambda: subscription.get_publisher_count() == 1, 'the publisher')

    def send(texts):
        for text in texts:
            publisher.publish(String(data=text))
        assert publisher.wait_for_all_acked()

    return send


def taken(subscription, enough=1000):
    """Return the blocks that a new `Taker` takes, as lists of bytes, and the number it returns."""
    blocks = []

    def keep(messages, _):
        blocks.append([message.tobytes() for message in messages])

    return blocks, Taker().take(subscription.handle.pointer, keep, enough)


def test_messages_of_equal_size_form_one_block(subscription, send):
    texts = ['one', 'two', 'six', 'longer', LARGE * 'x', '', LARGE * 'y', 'end']
    send(texts)
    blocks, number = taken(subscription)
    assert [len(block) for block in blocks] == [3, 1, 1, 1, 1, 1]
    assert [*chain(*blocks)] == [serialize_message(String(data=text)) for text in texts]
    assert number == len(texts)
    assert taken(subscription) == ([], 0)
