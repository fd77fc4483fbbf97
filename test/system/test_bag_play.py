"""`pkm bag-play`: a recorded cycle played into the graph, and the output of the subscribed nodes."""

import os
import re
import signal
import sys
from pathlib import Path
from threading import Thread
from time import monotonic, sleep

import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from pkm_core.bag.reader import raw_messages
from pkm_interfaces.msg import EncoderSample
from pkm_nodes.runtime.node import TICK_QOS

DOMAIN = 65
PKM = Path(sys.prefix) / 'bin' / 'pkm'
NODES = Path(sys.prefix) / 'lib' / 'pkm_nodes'
MOTION = """\
machine: four_dof
targets: [{by: {d1: 1 mm, d3: -1 mm, d5: 0.5 mm, d7: 1 mm}}]
move_time: 40 ms
settle_window: 40 ms
"""


@pytest.fixture(scope='module')
def bag(module_processes):
    """Return the bag of one cycle of 200 ms."""
    (module_processes.folder / 'small.yaml').write_text(MOTION)
    done = module_processes.run(PKM, 'run', '--cycles', 1, '--law', 'none', '--motion', 'small.yaml', '--out', 'run')
    assert done.returncode == 0, done.stdout + done.stderr
    [bag] = (module_processes.folder / 'run' / 'bags').iterdir()
    return bag


class Ear:
    """Subscriber in the test's domain; raw messages for comparisons of bytes."""

    def __init__(self):
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=DOMAIN, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node('ear', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = Thread(target=self._executor.spin)
        self._thread.start()

    def listen(self, message_type, topic, qos=TICK_QOS, raw=False):
        """Return a list to which every message on `topic` is appended."""
        messages = []
        self._node.create_subscription(message_type, topic, messages.append, qos, raw=raw)
        return messages

    def wait_for(self, condition, what):
        deadline = monotonic() + 60.0  # starting up on a busy two-core machine
        while not condition():
            assert monotonic() < deadline, f'waited in vain for {what}'
            sleep(0.05)

    def wait_for_publisher(self, topic):
        self.wait_for(lambda: self._node.count_publishers(topic), f'a publisher of {topic}')

    def close(self):
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def ear(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    ear = Ear()
    yield ear
    ear.close()


def recorded(bag, topic):
    return [data for _, _, data, _ in raw_messages(bag, [topic])]


def test_state_estimator_reproduces_the_recorded_poses(bag, processes, ear):
    """Bit for bit."""
    poses = ear.listen(PoseStamped, '/pkm/pose', raw=True)
    joint_states = ear.listen(JointState, '/pkm/joint_states', raw=True)
    processes.start(NODES / 'state_estimator')
    ear.wait_for_publisher('/pkm/pose')
    done = processes.run(PKM, 'bag-play', bag, '--rate', 0.5)
    assert done.returncode == 0, done.stdout + done.stderr
    assert '/pkm/pose is left to /pkm/state_estimator' in done.stdout
    assert '/pkm/joint_states is left to /pkm/state_estimator' in done.stdout
    assert len(recorded(bag, '/pkm/pose')) > 10
    ear.wait_for(lambda: len(joint_states) >= len(recorded(bag, '/pkm/joint_states')), 'the last joint state')
    assert poses == recorded(bag, '/pkm/pose')
    assert joint_states == recorded(bag, '/pkm/joint_states')


def test_messages_are_played_at_the_requested_rate_with_clock(bag, processes, ear):
    samples = ear.listen(EncoderSample, '/pkm/d3/encoder', raw=True)
    poses = ear.listen(PoseStamped, '/pkm/pose', raw=True)
    clocks = ear.listen(Clock, '/clock', qos_profile_sensor_data)
    done = processes.run(PKM, 'bag-play', bag, '--rate', 0.2)
    assert done.returncode == 0, done.stdout + done.stderr
    simulated, seconds = map(float, re.search(r'([\d.]+) s of simulated time in ([\d.]+) s', done.stdout).groups())
    assert seconds >= simulated / 0.2
    ear.wait_for(lambda: len(samples) >= len(recorded(bag, '/pkm/d3/encoder')), 'the last sample')
    assert samples == recorded(bag, '/pkm/d3/encoder')
    assert poses == recorded(bag, '/pkm/pose'), 'from the state estimator alone'
    times = [clock.clock.sec * 1_000_000_000 + clock.clock.nanosec for clock in clocks]
    assert times == sorted(times)
    assert set(times) <= set(range(0, 400_000_000, 10_000_000)), 'every 20th tick, as the machine sends it'
    assert times[-1] == max(time for *_, time in raw_messages(bag)) // 10_000_000 * 10_000_000


def test_loop_repeats_until_interrupted(bag, processes, ear):
    samples = ear.listen(EncoderSample, '/pkm/d1/encoder')
    player = processes.start(PKM, 'bag-play', bag, '--rate', 2.0, '--loop')
    ear.wait_for(lambda: sum(sample.index == 0 for sample in samples) >= 3, 'the third round')
    player.send_signal(signal.SIGINT)
    assert player.wait(timeout=30) == 130
    assert 'Traceback' not in (processes.folder / 'log').read_text()


def test_bag_is_not_played_into_a_running_cell(bag, processes, ear):
    processes.start(NODES / 'machine')
    ear.wait_for_publisher('/pkm/d1/encoder')
    done = processes.run(PKM, 'bag-play', bag)
    assert done.returncode == 1
    assert 'a cell is running; stop it or set another ROS_DOMAIN_ID' in done.stderr
    assert done.stderr.count('\n') == 1


@pytest.mark.parametrize(
    ('options', 'complaint'),
    [
        (['nowhere'], 'nowhere: no such file or folder'),
        (['empty'], 'not a bag of this cell: has 0 MCAP files'),
        (['text.mcap'], 'cannot be read as a bag'),
    ],
)
def test_path_without_a_bag_is_refused_in_one_line(processes, options, complaint):
    (processes.folder / 'empty').mkdir()
    (processes.folder / 'text.mcap').write_text('x' * 100)
    done = processes.run(PKM, 'bag-play', *options)
    assert done.returncode == 1
    assert complaint in done.stderr
    assert done.stderr.count('\n') == 1


def test_invalid_rate_is_refused(processes):
    done = processes.run(PKM, 'bag-play', os.curdir, '--rate', 0)
    assert done.returncode == 2
    assert '--rate' in done.stderr
