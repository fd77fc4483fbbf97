"""A foreign node that publishes on the topics of a cell: `python -m campaign.rogue SEED SECONDS [TOPIC ...]`."""

import sys
from contextlib import suppress
from random import Random
from time import monotonic, sleep

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message

from campaign.random_messages import damaged, random_message
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.messages.interfaces import find_interface
from pkm_nodes.runtime.node import RCLError

_FEW = 3


def _known(node):
    """Return {topic: type} of the cell, as far as this node knows it."""
    return {
        name: types[0]
        for name, types in node.get_topic_names_and_types()
        if name.startswith(('/pkm/', '/clock', '/diagnostics')) and '/_action/' not in name
    }


def _choose(node, draw, wanted, deadline):
    """Return {topic: type} of the `wanted` topics; without wanted ones, of a few at random of the whole cell."""
    while monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.02)
        known = _known(node)
        if wanted and known.keys() >= set(wanted):
            return {name: known[name] for name in wanted}
        if not wanted and node.count_publishers('/pkm/machine/cycle'):
            sleep(2.0)  # the rest of the cell becomes known
            known = _known(node)
            return {name: known[name] for name in draw.sample(sorted(known), min(_FEW, len(known)))}
    sys.exit(f'no cell with {wanted or "topics"}')


def main(seed, seconds, *wanted):
    """Publish random and damaged messages until `seconds` are over."""
    draw = Random(seed)
    rclpy.init()
    node = rclpy.create_node('rogue')
    heard = {'session': '', 'cycle': 1}

    def listen(event):
        heard.update(session=event.session, cycle=event.cycle, tick=(event.tick + 40) % (1 << 64), source=event.source)

    node.create_subscription(CycleEvent, '/pkm/cycle_events', listen, 100)
    deadline = monotonic() + seconds
    topics = _choose(node, draw, wanted, deadline)
    print('topics:', ', '.join(topics), flush=True)
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publishers = [node.create_publisher(find_interface(kind, 'msg'), name, latched) for name, kind in topics.items()]
    told = False
    while monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=draw.choice([0.001, 0.005, 0.02]))
        publisher = draw.choice(publishers)
        message = random_message(draw, publisher.msg_type, **heard)
        with suppress(RCLError):  # Fast DDS refuses bytes longer than the type allows
            publisher.publish(message if draw.random() < 0.7 else damaged(draw, serialize_message(message)))
        if not told:
            print('publishes', flush=True)
            told = True


main(int(sys.argv[1]), float(sys.argv[2]), *sys.argv[3:])
