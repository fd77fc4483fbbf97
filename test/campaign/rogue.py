"""A foreign node that publishes on the topics of a cell: `python -m campaign.rogue SEED SECONDS`."""

import sys
from random import Random
from time import monotonic, sleep

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message

from campaign.random_messages import damaged, random_message
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.messages.interfaces import find_interface


def main(seed, seconds, few=3):
    """Publish random and damaged messages on `few` topics at random until `seconds` are over."""
    draw = Random(seed)
    rclpy.init()
    node = rclpy.create_node('rogue')
    heard = {'session': '', 'cycle': 1}

    def listen(event):
        heard.update(session=event.session, cycle=event.cycle, tick=(event.tick + 40) % (1 << 64), source=event.source)

    node.create_subscription(CycleEvent, '/pkm/cycle_events', listen, 100)
    deadline = monotonic() + seconds
    while not node.count_publishers('/pkm/machine/cycle') and monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.2)
    sleep(2.0)  # the rest of the cell becomes known
    topics = {
        name: types[0]
        for name, types in node.get_topic_names_and_types()
        if name.startswith(('/pkm/', '/clock')) and '/_action/' not in name
    }
    chosen = draw.sample(sorted(topics), min(few, len(topics)))
    print('topics:', ', '.join(chosen), flush=True)
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publishers = [node.create_publisher(find_interface(topics[name], 'msg'), name, latched) for name in chosen]
    while monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=draw.choice([0.0, 0.002, 0.02]))
        publisher = draw.choice(publishers)
        message = random_message(draw, publisher.msg_type, **heard)
        publisher.publish(message if draw.random() < 0.7 else damaged(draw, serialize_message(message)))


main(int(sys.argv[1]), float(sys.argv[2]))
