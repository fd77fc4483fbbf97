"""
A graph of real nodes over real DDS, in one process and one thread, for every test of the nodes.

The test has a node of its own in it, publishes and listens like any other node, and decides when callbacks run. Every
module has a DDS domain that no other run on this machine uses at the time; every test has its own context.
"""

import gc
import tempfile
from collections import Counter
from fcntl import LOCK_EX, LOCK_NB, flock
from itertools import cycle, islice
from pathlib import Path
from time import monotonic

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustController, load_control
from pkm_core.machines import load_machine
from pkm_core.motion.planning import Motion, Target, plan
from pkm_core.motion.trajectory import to_joints
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.messages.conversions import trajectory_to_msg
from pkm_nodes.parts.cycle_events import NAMES
from pkm_nodes.runtime.node import PkmNode, reliable
from support.axis import Axis, Learning
from support.controllers import Controllers
from support.goals import CellStandIn, Goals

_DOMAINS = range(41, 60)
_next_domain = cycle(_DOMAINS)
# [s, wall] what is waited for takes milliseconds; the rest is reserve for a machine that does much else
_PATIENCE = 30.0
# [s, wall] how long nothing must happen before a test believes that nothing will
_SILENCE = 0.2


class Graph:
    """The nodes of one test, served by an executor while the test waits."""

    def __init__(self):
        self._executor = SingleThreadedExecutor()
        self._nodes = []
        self._has_litter = False
        self.node = PkmNode('test')
        self._add(self.node)
        self.events = self.listen(CycleEvent, 'cycle_events')

    def start(self, node_type, *, namespace='pkm', **parameters):
        """Return a running node with these parameters; a machine includes its motors and laser."""
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        self._has_litter = True  # until it is made; one that refuses its parameters cannot be destroyed
        node = node_type(namespace=namespace, parameter_overrides=overrides)
        self._has_litter = False
        for each in (node, *getattr(node, 'parts', ())):
            self._add(each)
        self._connect()
        return node

    def stop(self, node):
        """Remove a node, and the parts of a machine, from the graph."""
        for each in (node, *getattr(node, 'parts', ())):
            self._executor.remove_node(each)
            self._nodes.remove(each)
            each.destroy_node()

    def listen(self, message_type, topic, qos=None):
        """Return a list to which every message on `topic` is appended."""
        messages = []
        self.node.create_subscription(message_type, topic, messages.append, qos or reliable(1000))
        self._connect()
        return messages

    def publisher(self, message_type, topic, qos=None):
        """Return a publisher of the test, connected to all subscribers."""
        publisher = self.node.create_publisher(message_type, topic, qos or reliable(1000))
        self._connect()
        return publisher

    def call(self, service_type, name, request=None):
        """Return the response of a service."""
        client = self.node.create_client(service_type, name)
        self.spin_until(client.service_is_ready, f'service {name}')
        future = client.call_async(request or service_type.Request())
        self.spin_until(future.done, f'the answer of service {name}')
        self.node.destroy_client(client)
        return future.result()

    def next_event(self, kind, **fields):
        """Wait for an event of `kind` with these fields, remove it from `events` and return it."""
        wanted = {'event': kind, **fields}

        def found():
            return [e for e in self.events if all(getattr(e, name) == value for name, value in wanted.items())]

        self.spin_until(found, f'the cycle event {NAMES[kind]} {fields or ""}')
        event = found()[0]
        self.events.remove(event)
        return event

    def spin_until(self, condition, what, timeout=_PATIENCE):
        """Serve the nodes until `condition()` is true; on a timeout fail with the text `what`."""
        deadline = monotonic() + timeout
        while not condition():
            if monotonic() > deadline:
                pytest.fail(f'waited {timeout:.0f} s in vain for {what}')
            self._executor.spin_once(timeout_sec=0.05)

    def spin_in_silence(self):
        """Serve the nodes until all messages sent have arrived, before a test asserts that none has."""
        end = monotonic() + _SILENCE
        self.spin_until(lambda: monotonic() > end, 'the end of the silence')

    def close(self):
        """Destroy all nodes."""
        self._executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        if self._has_litter:
            gc.collect()

    def _add(self, node):
        self._nodes.append(node)
        self._executor.add_node(node)

    def _connect(self):
        """Wait until every publisher is matched with all its readers; later messages arrive."""
        readers = Counter(subscription.topic_name for node in self._nodes for subscription in node.subscriptions)
        publishers = [publisher for node in self._nodes for publisher in node.publishers]
        self.spin_until(
            lambda: all(p.get_subscription_count() >= readers[p.topic_name] for p in publishers),
            'publishers and subscriptions to find each other',
        )


@pytest.fixture(scope='module')
def domain_id():
    """Return a DDS domain that no other module or test run uses."""
    for number in islice(_next_domain, len(_DOMAINS)):
        try:
            lock = (Path(tempfile.gettempdir()) / f'pkm_test_domain_{number}').open('w')
            flock(lock, LOCK_EX | LOCK_NB)
        except OSError:  # taken
            continue
        with lock:
            yield number
        return
    pytest.fail(f'all ROS domains from {_DOMAINS[0]} to {_DOMAINS[-1]} are in use on this machine')


@pytest.fixture
def graph(domain_id, monkeypatch):
    """Return a `Graph` with only the test's own node in it."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rclpy.init(domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)  # Ctrl-C is pytest's
    try:
        graph = Graph()
        yield graph
        graph.close()
    finally:
        rclpy.shutdown()


@pytest.fixture(scope='session')
def machine():
    """Return the machine of the cell."""
    return load_machine('four_dof')


@pytest.fixture(scope='session')
def short_motion(machine):
    """Return a pose trajectory of 40 samples: 0.2 mm forth and back."""
    motion = Motion(
        machine=machine.name,
        targets=[Target(by=dict.fromkeys(machine.joints, 2e-4))],
        lead_rest=1e-3,
        move_time=5e-3,
        settle_window=4e-3,
    )
    return plan(machine, motion)


@pytest.fixture
def joint_trajectory(machine, short_motion):
    """Return a function that makes the joint message of `short_motion`."""
    joints = to_joints(machine, short_motion)

    def message(cycle, *, motion='short', **fields):
        return trajectory_to_msg(joints, cycle=cycle, motion=motion, **fields)

    return message


@pytest.fixture
def axis(graph, joint_trajectory):
    return Axis(graph, joint_trajectory)


@pytest.fixture
def law(machine):
    """Return the law of d3 of the core; the short motion is not loaded."""
    return RobustController(
        load_control(machine)['d3'], load_model(machine)['d3'], machine.sample_time, machine.voltage_limit
    )


@pytest.fixture
def learning(graph):
    return Learning(graph)


@pytest.fixture
def goals(graph):
    """Return a client of execute_motion."""
    goals = Goals(graph)
    yield goals
    goals.close()


@pytest.fixture
def stand_in(graph):
    """Return the replacement of the cell downstream of pose_trajectory."""
    return CellStandIn(graph)


@pytest.fixture
def controllers(graph):
    """Return the replacement of the joint controllers."""
    return Controllers(graph)
