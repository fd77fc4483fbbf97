"""`pkm go-to` and `pkm home`: move the machine of a running cell to a pose, or home, and stay there."""

import os
from typing import Annotated

import typer

from pkm_core.errors import PkmError
from pkm_core.machines.checks import ANGLES
from pkm_core.quantities import QuantityError, to_si
from pkm_core.verbs.options import NamespaceOption
from pkm_nodes.graph import NAMESPACE, namespace_of
from pkm_nodes.runtime.discovery import discover_on_this_computer

# [s, wall] to find the action
_FOUND = 10.0
# [s, wall] to the end of the goal: the longest move takes 20 s of simulated time
_ENDED = 120.0
_COORDINATES = ('x', 'y', 'z', 'phi')

MoveTimeOption = Annotated[
    str, typer.Option(help="Duration of the move, such as '0.1 s'; default: 70 ms, or the shortest allowed if longer.")
]


def go_to(
    coordinates: Annotated[
        list[str], typer.Argument(help='Coordinates with unit: x=91mm z=124mm phi=-45deg; the others keep their value.')
    ],
    by: Annotated[bool, typer.Option('--by', help='Displacements from where the machine stands.')] = False,
    move_time: MoveTimeOption = '',
    namespace: NamespaceOption = NAMESPACE,
):
    """
    Move the machine of a running cell to a pose; it stays there.

    Runs one recorded cycle, straight in joint space. The exit code is 1 if the pose is refused or not reached.

    Example: `pkm go-to --by z=1mm`
    """
    values = _values(coordinates)
    duration = _duration(move_time)
    from pkm_interfaces.action import GoTo
    from pkm_interfaces.msg import PlatformPose

    goal = GoTo.Goal(pose=PlatformPose(**values), coordinates=list(values), relative=by, move_time=duration)
    pose = _run(GoTo, 'go_to', goal, namespace).pose
    typer.echo(
        f'the machine stands at x {1e3 * pose.x:.4f} mm, y {1e3 * pose.y:.4f} mm, z {1e3 * pose.z:.4f} mm, '
        f'phi {pose.phi:.6f} rad'
    )


def home(move_time: MoveTimeOption = '', namespace: NamespaceOption = NAMESPACE):
    """
    Move the machine of a running cell home.

    Runs one recorded cycle, or none if it stands there. After a fault use the service machine/reset instead.

    Example: `pkm home`
    """
    duration = _duration(move_time)
    from pkm_interfaces.action import Home

    _run(Home, 'home', Home.Goal(move_time=duration), namespace)
    typer.echo('the machine stands at home')


def _values(words):
    """Return {coordinate: value [m, rad]} of words such as x=1mm."""
    values = {}
    for word in words:
        name, _, text = word.partition('=')
        if name not in _COORDINATES or name in values:
            raise PkmError(f'go-to: {word!r} given; expected each of {", ".join(_COORDINATES)} at most once, as x=91mm')
        try:
            values[name] = to_si(text, 'rad' if name in ANGLES else 'm')
        except QuantityError as error:
            raise PkmError(f'go-to: {name}: {error}') from None
    return values


def _duration(text):
    """Return a duration [s], 0 for ''."""
    try:
        return to_si(text, 's') if text else 0.0
    except QuantityError as error:
        raise PkmError(f'move-time: {error}') from None


def _run(kind, name, goal, namespace):
    """Return the result of `goal`; `PkmError` if there is no cell, or with the reason why it was not reached."""
    discover_on_this_computer()
    import rclpy
    from action_msgs.msg import GoalStatus
    from rclpy.action import ActionClient

    namespace = namespace_of(namespace)
    rclpy.init()
    try:
        # hidden and without services of its own: the recorder asks every other node for its parameters
        node = rclpy.create_node(f'_pkm_{name}', namespace=namespace, start_parameter_services=False)
        client = ActionClient(node, kind, name)
        if not client.wait_for_server(_FOUND):
            domain = os.environ.get('ROS_DOMAIN_ID', '0')
            raise PkmError(f'{namespace}/{name}: no cell offers it in ROS domain {domain} within {_FOUND:g} s')
        answer = _wait(node, client.send_goal_async(goal), name).get_result_async()
        ended = _wait(node, answer, name)
        if ended.status != GoalStatus.STATUS_SUCCEEDED:
            raise PkmError(ended.result.message)
        return ended.result
    finally:
        rclpy.try_shutdown()


def _wait(node, future, name):
    import rclpy

    rclpy.spin_until_future_complete(node, future, timeout_sec=_ENDED)
    if not future.done():
        raise PkmError(f'{name}: no answer within {_ENDED:g} s')
    return future.result()
