"""`ros2 action send_goal`; `info`, `list` and `type` are in action_graph.py."""

import sys

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

from pkm_core.interrupts import held_back
from pkm_nodes.messages.interfaces import find_interface
from pkm_nodes.ros2 import action_graph
from pkm_nodes.ros2.messages import make_message, message_to_yaml, parse_yaml
from pkm_nodes.ros2.shared import FIND_TIMEOUT, NODE_PREFIX, add_commands, ros_node, spin_until_done


def add_arguments(parser):
    """Add the verbs of `ros2 action`."""
    verbs = add_commands(parser, {**action_graph.VERBS, 'send_goal': 'Send an action goal'})
    action_graph.add_arguments(verbs)
    verb = verbs['send_goal']
    verb.set_defaults(main=send_goal)
    verb.add_argument('action_name', help="Name of the ROS action (e.g. '/fibonacci')")
    verb.add_argument('action_type', help="Type of the ROS action (e.g. 'example_interfaces/action/Fibonacci')")
    values = verb.add_mutually_exclusive_group()
    values.add_argument('goal', nargs='?', default='{}', help="Goal request values in YAML format (e.g. '{order: 10}')")
    values.add_argument('--stdin', action='store_true', help='Read goal from standard input')
    verb.add_argument('-f', '--feedback', action='store_true', help='Echo feedback messages for the goal')


def send_goal(args):
    """Send a goal, print its status and result; cancel it if the command is interrupted."""
    action = find_interface(args.action_type, 'action')
    values = parse_yaml(sys.stdin.read() if args.stdin else args.goal)
    try:
        goal = make_message(action.Goal, values)
    except Exception as error:  # the message of any converter; the user corrects the value
        return f'Failed to populate message fields: {error!r}'
    with ros_node(f'{NODE_PREFIX}_send_goal_{args.action_type.replace("/", "_")}') as node:
        client = ActionClient(node, action, args.action_name)
        print('Waiting for an action server to become available...')
        if not client.wait_for_server(FIND_TIMEOUT):
            return f"No action server '{args.action_name}' of type '{args.action_type}' within {FIND_TIMEOUT} s"
        print(f'Sending goal:\n     {message_to_yaml(goal)}')
        check = _presence_of_server(node, args.action_name)
        pending = client.send_goal_async(goal, _print_feedback if args.feedback else None)
        try:
            return _follow(node, pending, check)
        except _ServerLeftError:
            raise
        except BaseException:  # Ctrl-C, SIGTERM, a closed pipe: the machine must not keep moving
            with held_back():
                _cancel(node, pending)
            raise


def _print_feedback(msg):
    print(f'Feedback:\n    {message_to_yaml(msg.feedback)}')


class _ServerLeftError(RuntimeError):
    """The action server is gone: a goal has no answer, and cannot be cancelled."""


def _presence_of_server(node, action_name):
    """
    Return a function that raises `_ServerLeftError` when the servers that are there now have left the graph.

    DDS removes a killed process after 20 s at most.
    """
    topic = node.resolve_topic_name(f'{action_name}/_action/status')

    def servers():
        return {bytes(info.endpoint_gid) for info in node.get_publishers_info_by_topic(topic)}

    first = servers()

    def check():
        if first and not first & servers():
            raise _ServerLeftError(f"The action server '{action_name}' has left the graph; the goal is lost")

    return check


def _follow(node, pending, check):
    """Print the answer to the goal and its result."""
    handle = spin_until_done(node, pending, check=check)
    if not handle.accepted:
        print('Goal was rejected.')
        return
    print(f'Goal accepted with ID: {bytes(handle.goal_id.uuid).hex()}\n')
    answer = spin_until_done(node, handle.get_result_async(), check=check)
    names = {value: name for name, value in vars(GoalStatus).items() if name.startswith('STATUS_')}
    print(f'Result:\n    {message_to_yaml(answer.result)}')
    print(f'Goal finished with status: {names.get(answer.status, "UNKNOWN").removeprefix("STATUS_")}')


def _cancel(node, pending):
    """Cancel the goal unless it is finished; waits for its acceptance if that has not arrived."""
    handle = spin_until_done(node, pending, FIND_TIMEOUT)
    if not handle.accepted or handle.status >= GoalStatus.STATUS_SUCCEEDED:
        return
    print('Canceling goal...')
    for last in (False, False, True):  # the machine moves: an answer that is lost is requested again
        try:
            answer = spin_until_done(node, handle.cancel_goal_async(), FIND_TIMEOUT)
            break
        except RuntimeError:
            if last:
                raise
    if not answer.goals_canceling:
        raise RuntimeError('Failed to cancel goal')
    print('Goal canceled.')
