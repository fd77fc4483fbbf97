"""What the verbs share. rclpy is imported where it is needed, so that `run` and `bag` start without it."""

import argparse
import contextlib
import importlib
import os
import time

FIND_TIMEOUT = 5.0  # [s] what is named on the command line is waited for so long
GRAPH_TIMEOUT = 3.0  # [s] at most, to learn the graph without a daemon; a busy machine was seen to take 2
GRAPH_QUIET = 0.5  # [s] without a change, and a graph with nodes counts as known
POLL = 0.1  # [s] a signal is answered within this time
TOPIC_HELP = "Name of the ROS topic to listen to (e.g. '/chatter')"
NODE_PREFIX = '_ros2cli'  # the underscore keeps these nodes out of `node list`

KINDS = {  # what makes a Python class an interface of that kind
    'msg': ('message', ['SLOT_TYPES']),
    'srv': ('service', ['Request', 'Response']),
    'action': ('action', ['Goal', 'Result', 'Feedback']),
}


def add_commands(parser, commands):
    """Give parser the sub-commands {name: description}, listed as ros2cli lists them; return {name: its parser}."""
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


def add_graph_arguments(parser):
    """Add the arguments of every verb that looks at the running graph."""
    parser.add_argument(
        '--spin-time',
        type=float,
        metavar='SPIN_TIME',
        help=f'Spin time in seconds to wait for discovery (default: until the graph is quiet, {GRAPH_TIMEOUT} at most)',
    )
    parser.add_argument('-s', '--use-sim-time', action='store_true', help='Enable ROS simulation time')
    parser.add_argument('--no-daemon', action='store_true', help='For compatibility; this tool has no daemon')


def number(kind, accepts, wanted):
    """Return an argparse type for the numbers of a kind that accepts() lets pass."""

    def parse(text):
        with contextlib.suppress(ValueError):
            if accepts(value := kind(text)):
                return value
        raise argparse.ArgumentTypeError(f'value must be {wanted}')

    return parse


def find_interface(type_name, kind):
    """Return the Python class of 'package/Name' or 'package/kind/Name'; kind is msg, srv or action."""
    word, members = KINDS[kind]
    parts = type_name.split('/')
    if len(parts) == 2:
        parts.insert(1, kind)
    try:
        interface = getattr(importlib.import_module('.'.join(parts[:-1])), parts[-1])
    except (AttributeError, ImportError, TypeError, ValueError):
        interface = None
    if not all(hasattr(interface, member) for member in members):
        raise RuntimeError(f'The passed {word} type is invalid')
    return interface


@contextlib.contextmanager
def ros_node(name=f'{NODE_PREFIX}_{os.getpid()}', use_sim_time=False):
    """Open a node for one command. Ctrl-C stays a KeyboardInterrupt with ROS alive, so a goal can be cancelled."""
    import rclpy
    from rclpy.exceptions import NameValidationException
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        sim_time = rclpy.Parameter('use_sim_time', value=use_sim_time)
        node = rclpy.create_node(name, start_parameter_services=False, parameter_overrides=[sim_time])
        yield node
        node.destroy_node()
    except NameValidationException as error:
        raise RuntimeError(str(error)) from error
    finally:
        rclpy.try_shutdown()


@contextlib.contextmanager
def graph_node(args):
    """Open a node and let it learn the graph before the command reads it."""
    with ros_node(use_sim_time=args.use_sim_time) as node:
        settle(node, args.spin_time)
        yield node


def settle(node, spin_time=None):
    """Return when the graph has nodes and has been quiet for a while, or after the longest wait."""
    start = changed = time.monotonic()
    seen = None
    while (now := time.monotonic()) - start < (GRAPH_TIMEOUT if spin_time is None else spin_time):
        graph = (node.get_node_names_and_namespaces(), node.get_topic_names_and_types())
        if graph != seen:
            seen, changed = graph, now
        has_nodes = any(not name.startswith(NODE_PREFIX) for name, _ in graph[0])  # more than tools like this one
        if has_nodes and spin_time is None and now - changed > GRAPH_QUIET:
            return
        time.sleep(POLL)


def wait_for(found, timeout=FIND_TIMEOUT):
    """Poll found() until it returns something true, for the timeout at most; return its last answer."""
    deadline = time.monotonic() + timeout
    while not (answer := found()) and time.monotonic() < deadline:
        time.sleep(POLL)
    return answer


def spin_until_done(node, future, timeout=float('inf')):
    """Spin until the future is done and return its result."""
    import rclpy

    deadline = time.monotonic() + timeout
    while not future.done():
        if time.monotonic() > deadline:
            raise RuntimeError(f'No answer within {timeout} s')
        rclpy.spin_once(node, timeout_sec=POLL)
    return future.result()


def find_topic_class(node, topic_name):
    """Return the message class of a topic, which is waited for."""
    full_name = node.resolve_topic_name(topic_name)

    def types():
        return dict(node.get_topic_names_and_types()).get(full_name)

    found = wait_for(types)
    if not found:
        print(f'WARNING: topic [{topic_name}] does not appear to be published yet')
        raise RuntimeError('Could not determine the type for the passed topic')
    if len(found) > 1:
        raise RuntimeError(f"Cannot echo topic '{topic_name}', as it contains more than one type: [{', '.join(found)}]")
    try:
        return find_interface(found[0], 'msg')
    except RuntimeError:
        raise RuntimeError(f"The message type '{found[0]}' is invalid") from None


def message_filter(expression):
    """Return the predicate of a message m that a Python expression of the command line states; None passes all."""
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
