"""Arguments, nodes and waiting of the verbs. rclpy is imported on use, so that `run` and `bag` start without it."""

import argparse
import contextlib
import os
import time

from pkm_core.interrupts import held_back
from pkm_nodes.messages.interfaces import find_interface
from pkm_nodes.runtime.discovery import DISCOVERY_TIME, POLL, wait_for

FIND_TIMEOUT = 5.0  # [s] to find a topic, service or action that the command line names
TOPIC_HELP = "Name of the ROS topic to listen to (e.g. '/chatter')"
NODE_PREFIX = '_ros2cli'  # the underscore keeps these nodes out of `node list`


def add_commands(parser, commands):
    """Add the sub-commands {name: description} to `parser`, listed as in ros2cli; return {name: its parser}."""
    width = max(map(len, commands))
    group = parser.add_subparsers(
        title='Commands',
        description='\n'.join(f'{name:{width}}  {description}' for name, description in commands.items()),
        metavar=f'Call `{parser.prog} <command> -h` for more detailed usage.',
    )
    parser.set_defaults(main=lambda args: parser.print_help())
    return {
        name: group.add_parser(name, description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
        for name, text in commands.items()
    }


def add_graph_arguments(parser, spin_time=DISCOVERY_TIME):
    """Add the arguments of all verbs that inspect the running graph."""
    parser.add_argument(
        '--spin-time',
        type=number(float, lambda seconds: seconds >= 0, 'non-negative'),
        default=spin_time,
        help='Spin time in seconds to wait for discovery (default: %(default)s)',
    )
    parser.add_argument('-s', '--use-sim-time', action='store_true', help='Enable ROS simulation time')
    parser.add_argument('--no-daemon', action='store_true', help='For compatibility; this tool has no daemon')


def names_and_types(names, include_hidden):
    """Return [(name, types as text)] of the graph's `names`; a part of a hidden name begins with an underscore."""
    return [
        (name, ', '.join(types))
        for name, types in names
        if include_hidden or not any(part.startswith('_') for part in name.split('/'))
    ]


def print_names(listed, *, count=False, show_types=False):
    """Print the (name, types) of `listed` as the `list` verbs do."""
    if count:
        print(len(listed))
        return
    for name, types in listed:
        print(f'{name} [{types}]' if show_types else name)


def find_types(names, name, timeout):
    """Return the types of `name` in the answers of `names()`, as soon as it is there; None after `timeout` [s]."""
    return wait_for(lambda: dict(names()).get(name), timeout)


def number(kind, accepts, wanted):
    """Return an argparse type: numbers of type `kind` for which `accepts(number)` is true."""

    def parse(text):
        with contextlib.suppress(ValueError):
            if accepts(value := kind(text)):
                return value
        raise argparse.ArgumentTypeError(f'value must be {wanted}')

    return parse


@contextlib.contextmanager
def ros_node(name=f'{NODE_PREFIX}_{os.getpid()}', use_sim_time=False):
    """Open a node for one command. A signal raises `Interrupted` and leaves ROS up: a goal can be cancelled."""
    import rclpy
    from rclpy.exceptions import NameValidationException
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        sim_time = rclpy.Parameter('use_sim_time', value=use_sim_time)
        node = rclpy.create_node(name, start_parameter_services=False, parameter_overrides=[sim_time])
        yield node
        node.destroy_node()
    except (NameValidationException, ValueError) as error:  # rclpy refuses a name with either
        raise RuntimeError(str(error)) from error
    finally:
        rclpy.try_shutdown()


def spin_until_done(node, future, timeout=float('inf'), check=lambda: None):
    """
    Spin until the future is done and return its result; `check()` may raise between two callbacks.

    An exception within rclpy can leave an action client without answers: one cancel request in ten had none.
    """
    import rclpy

    deadline = time.monotonic() + timeout
    while not future.done():
        if time.monotonic() > deadline:
            raise RuntimeError(f'No answer within {timeout} s')
        check()
        with held_back():
            rclpy.spin_once(node, timeout_sec=POLL)
    return future.result()


def wait_for_publishers(node, topic_name, timeout):
    """Wait for the first publisher of a topic, then one poll more for others."""
    if wait_for(lambda: node.count_publishers(topic_name), timeout):
        time.sleep(POLL)


def find_topic_class(node, topic_name):
    """Return the message class of a topic in the graph."""
    types = dict(node.get_topic_names_and_types()).get(node.resolve_topic_name(topic_name), [])
    if not types:
        print(f'WARNING: topic [{topic_name}] does not appear to be published yet')
        raise RuntimeError('Could not determine the type for the passed topic')
    if len(types) > 1:
        raise RuntimeError(f"Cannot echo topic '{topic_name}', as it contains more than one type: [{', '.join(types)}]")
    try:
        return find_interface(types[0], 'msg')
    except RuntimeError:
        raise RuntimeError(f"The message type '{types[0]}' is invalid") from None


def message_filter(expression):
    """Return the predicate of a message m that a Python expression of the command line defines; None accepts all."""
    if expression is None:
        return lambda msg: True
    try:
        code = compile(expression, '--filter', 'eval')
    except SyntaxError as error:
        raise RuntimeError(f"Invalid filter '{expression}': {error}") from error

    def passes(msg):
        try:
            return eval(code, {'m': msg})
        except Exception as error:
            raise RuntimeError(f"Invalid filter '{expression}': {error}") from error

    return passes
