"""
The choice between the fast path of the servo tick and rclpy's public API.

lockstep.py and queues.py use parts of rclpy and rcl that are not public. They are used only with the versions they were
made for, and if a self-test takes the same bytes through them as rclpy does. Otherwise the process uses rclpy's public
publish, takes and executor, which are slower, and logs one line with the reason.
"""

import os
from pathlib import Path
from time import monotonic
from uuid import uuid4
from xml.etree import ElementTree

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import LoggingSeverity, get_logger
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from pkm_core.errors import ConfigError
from pkm_nodes.runtime.groups import HotGroup, PatientGroup
from pkm_nodes.runtime.tick_subscription import TickSubscription

# environment variable: 1 selects rclpy's public API
SWITCH = 'PKM_PUBLIC_RCLPY'
# versions the fast path was made for; within one ROS distribution the third number only counts bug fixes
MADE_FOR = {'rclpy': '7.1', 'rcl': '9.2'}
# messages of the self-test: equal sizes make one block, others follow
_MESSAGES = [serialize_message(String(data=text)) for text in ('one', 'two', 'longer than these', '', 'end')]
# [s, wall] limit of one half of the self-test, which takes milliseconds
_TRIAL_TIMEOUT = 5.0


class FastPath:
    """
    The fast path of one process.

    Parameters
    ----------
    made_for : dict of str to str
        First two numbers of the version by package.

    """

    def __init__(self, made_for=MADE_FOR):
        self._made_for = made_for
        self._obstacle = None  # why it is not used, '' if it is; None before the decision

    def is_used(self, context):
        """Return whether this process uses the fast path; the first call decides and logs a refusal."""
        if self._obstacle is None:
            self._obstacle = self._find_obstacle(context)
            if self._obstacle:
                get_logger('pkm').warning(f"servo tick: {self._obstacle}; using rclpy's public executor (slower)")
        return not self._obstacle

    def sender(self, publisher, context):
        """Return the function that publishes serialized messages with `publisher`."""
        # `publish` checks the type of every message
        return publisher.handle.publish_raw if self.is_used(context) else publisher.publish

    def executor(self, context):
        """Return an executor for the nodes of this process."""
        if not self.is_used(context):
            return SingleThreadedExecutor(context=context)
        from pkm_nodes.runtime.lockstep import LockstepExecutor

        return LockstepExecutor(context=context)

    def stepped_executor(self, context):
        """Return an executor with `spin_once`, for a client."""
        if not self.is_used(context):
            return SingleThreadedExecutor(context=context)
        from pkm_nodes.runtime.sender_takes import SteppedExecutor

        return SteppedExecutor(context=context)

    def _find_obstacle(self, context):
        switch = os.environ.get(SWITCH, '0')
        if switch not in ('0', '1'):
            raise ConfigError(f'{SWITCH}: {switch!r} given; allowed: 0, 1')
        if switch == '1':
            return f'{SWITCH} is 1'
        found = {package: _version(package) for package in self._made_for}
        if any(found[package].split('.')[:2] != made.split('.') for package, made in self._made_for.items()):
            return f'found {_listed(found)}; expected {_listed(self._made_for)}'
        try:
            from pkm_nodes.runtime.lockstep import LockstepExecutor

            fast = _trial(context, LockstepExecutor, lambda publisher: publisher.handle.publish_raw)
            public = _trial(context, SingleThreadedExecutor, lambda publisher: publisher.publish)
        except Exception as error:
            if not context.ok():  # interrupted
                raise
            return f'found {type(error).__name__}: {error} in the self-test of the fast path; expected none'
        if fast != public:
            return f'found {fast} in the self-test of the fast path; expected {public}, as rclpy takes it'
        return ''


FAST_PATH = FastPath()  # of this process


def _version(package):
    """Return the version of a package of ROS that is installed beside rclpy, 'unknown' without its manifest."""
    for folder in Path(rclpy.__file__).parents:
        manifest = folder / 'share' / package / 'package.xml'
        if manifest.is_file():
            return ElementTree.parse(manifest).findtext('version', 'unknown').strip()
    return 'unknown'


def _listed(versions):
    return ', '.join(f'{package} {version}' for package, version in versions.items())


def _rows(data):
    return [data] if isinstance(data, bytes) else [row.tobytes() for row in data]


class _Ended(Exception):  # noqa: N818 (no error: the end of a trial)
    pass


def _trial(context, make_executor, sender_of):
    """Return what a hot and a patient subscription have taken, as far as both paths must agree."""
    name = f'_fast_path_{uuid4().hex}'  # hidden from tools, and no other process has it
    options = {'use_global_arguments': False, 'enable_rosout': False, 'start_parameter_services': False}
    node = Node(name, context=context, **options)
    node.get_logger().set_level(LoggingSeverity.ERROR)  # messages of another size are part of the trial
    hot, patient, senders, unsent = [], [], set(), list(_MESSAGES)
    qos = QoSProfile(depth=len(_MESSAGES))
    node.hot_group, patient_group = HotGroup(), PatientGroup(lambda: None)

    def take_patiently(data, gids=()):
        patient.extend(_rows(data))
        senders.update(gid.tobytes() for gid in gids)

    tick = TickSubscription(node, String, name, hot.append, qos, size=len(_MESSAGES[0]))
    node.create_subscription(String, name, take_patiently, qos, callback_group=patient_group, raw=True)
    publisher = node.create_publisher(String, name, qos)
    send, deadline = sender_of(publisher), monotonic() + _TRIAL_TIMEOUT

    def step():
        while unsent and publisher.get_subscription_count() == 2 and tick.bind():
            send(unsent.pop(0))
        if len(hot) + tick.refused == len(patient) == len(_MESSAGES) or monotonic() > deadline:
            raise _Ended

    node.create_timer(1e-3, step, clock=Clock(clock_type=ClockType.STEADY_TIME))
    executor = make_executor(context=context)
    try:
        executor.add_node(node)
        executor.spin()
        raise ExternalShutdownException
    except _Ended:
        # the API of rclpy has no senders; the fast path must name the publisher that the graph lists
        return hot, tick.refused, patient, senders <= {tick.publisher.gid}, tick.foreign
    finally:
        executor.shutdown()
        node.destroy_node()
