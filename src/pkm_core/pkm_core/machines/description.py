"""
Visual description of a machine: its links as a tree with one moving joint each.

Used for URDF, transforms, markers and live page. A joint moves with a variable of `joint_positions`: a motor or a
passive joint of the machine. A parallel mechanism is not a tree. Each loop is cut at one joint, where the links
coincide because their variables are consistent, without a constraint. Lengths and reference marks are those of
config/machines, of its section `built` if there is one; the thickness of bars and blocks is chosen for display.
"""

import math
from dataclasses import dataclass

import numpy as np

from pkm_core.errors import ConfigError

ROOT = 'base_link'  # the fixed frame, named as REP 105 names the one of a robot
TOOL = 'tool0'  # the frame of the pose, named as for industrial robots in ROS

_BLUE, _ORANGE, _GREEN = (0.12, 0.47, 0.71), (0.90, 0.45, 0.10), (0.17, 0.63, 0.37)
_STEEL, _DARK = (0.72, 0.74, 0.77), (0.25, 0.27, 0.30)
_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_UP = (0.0, -1.0, 0.0)  # rotation about it raises a bar along +x


@dataclass(frozen=True)
class Box:
    """A visible part of a link: a box with its sides along the link's axes."""

    size: tuple[float, float, float]  # [m]
    centre: tuple[float, float, float]  # [m], from the link's origin
    colour: tuple[float, float, float]  # red, green, blue from 0 to 1


@dataclass(frozen=True)
class Link:
    """A rigid part and the joint that connects it to its parent."""

    name: str
    parent: str
    joint: str
    kind: str  # joint type of URDF: prismatic, continuous, fixed
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the joint in the parent [m]
    yaw: float = 0.0  # of the joint's frame about the parent's z [rad]
    axis: tuple[float, float, float] = _Z  # of the joint, in its frame
    variable: str = ''  # the joint position is factor times this entry of `joint_positions`
    factor: float = 1.0
    boxes: tuple[Box, ...] = ()


def links(machine):
    """Return the links of `machine` without the root, parents first; the last is `TOOL`, the frame of the pose."""
    try:
        describe = _DESCRIPTIONS[machine.config.mechanism]
    except KeyError:
        raise ConfigError(f'{machine.name}: mechanism {machine.config.mechanism!r} has no description') from None
    return tuple(describe(machine))


def base_boxes(machine):
    """Return the visible boxes of the root: one rail per direction, under the sliders."""
    rails = {}
    for link, lower, upper in zip(_sliders(machine), machine.limits.lower, machine.limits.upper, strict=True):
        if link.parent == ROOT:
            low, high = rails.get(link.axis, (math.inf, -math.inf))
            rails[link.axis] = (min(low, lower), max(high, upper))
    return tuple(
        _bar(axis, low - 20e-3, high + 20e-3, 14e-3, 6e-3, _DARK, z=-17e-3) for axis, (low, high) in rails.items()
    )


def joint_positions(machine, q):
    """Return {name: position [m, rad]} of motors and passive joints at `q` (n,); `WorkspaceError` if out of reach."""
    passive = {name: float(angle) for name, angle in machine.passive_angles(q).items()}
    return dict(zip(machine.joints, np.asarray(q).tolist(), strict=True)) | passive


def frames(links_of_machine, positions):
    """
    Return {link: (quaternion (w, x, y, z), origin [m])} of every link in the base frame.

    Parameters
    ----------
    links_of_machine : sequence of Link
        From `links`.
    positions : dict
        From `joint_positions`.

    """
    found = {ROOT: ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))}
    for link in links_of_machine:
        turn, origin = found[link.parent]
        local_turn, local_origin = local_frame(link, positions)
        found[link.name] = (product(turn, local_turn), moved(turn, origin, local_origin))
    return found


def local_frame(link, positions):
    """Return the quaternion (w, x, y, z) and the origin [m] of `link` in its parent."""
    turn, origin = _turn(_Z, link.yaw), link.origin
    if not link.variable:
        return turn, origin
    position = link.factor * positions[link.variable]
    if link.kind == 'prismatic':
        return turn, moved(turn, origin, [position * part for part in link.axis])
    return product(turn, _turn(link.axis, position)), origin


def moved(turn, origin, point):
    """Return in the parent frame the `point` (x, y, z) of a frame at `origin`, rotated by the quaternion `turn`."""
    w, x, y, z = turn
    _, *rotated = product(product(turn, (0.0, *point)), (w, -x, -y, -z))
    return tuple(start + part for start, part in zip(origin, rotated, strict=True))


def _bar(axis, start, end, width, height, colour, *, z=0.0):
    """Return a box along the x or y `axis` from `start` to `end`."""
    along = np.array(axis)
    size = (end - start) * along + width * (np.array([1.0, 1.0, 0.0]) - along) + height * np.array(_Z)
    return Box(tuple(size.tolist()), (*(0.5 * (start + end) * along[:2]).tolist(), z), colour)


def _turn(axis, angle):
    """Return the quaternion of a rotation by `angle` [rad] about the unit vector `axis`."""
    sine = math.sin(0.5 * angle)
    return (math.cos(0.5 * angle), *(sine * part for part in axis))


def product(a, b):
    """Return the product of two quaternions (w, x, y, z): first `b`, then `a`."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def _sliders(machine):
    return [link for link in links(machine) if link.kind == 'prismatic']


def _built(machine):
    """Return the lengths and marks of a machine: the measured ones of its section `built`, or those of the drawing."""
    return machine.config.built or machine.Built.as_drawn(machine.config.geometry)


def _slider(joint, axis, mark=0.0):
    """Return the slider of a motor; its origin is the pivot of its link, `mark` [m] before the encoder's reading."""
    block = Box((24e-3, 24e-3, 10e-3), (0.0, 0.0, -9e-3), _BLUE)
    origin = tuple(0.0 - mark * part for part in axis)
    return Link(f'slider_{joint}', ROOT, joint, 'prismatic', origin, axis=axis, variable=joint, boxes=(block,))


def _arm(name, slider, variable, length):
    """Return a link in the plane, from the pivot of a slider."""
    return Link(
        name, slider, variable, 'continuous', variable=variable, boxes=(_bar(_X, 0.0, length, 7e-3, 5e-3, _STEEL),)
    )


def _platform(name, arm, variable, length, axis, offset):
    """Return the platform at the end of an arm, held level by a belt; P or Q is at `offset` along `axis`."""
    bar = _bar(axis, 0.0, offset, 10e-3, 5e-3, _GREEN, z=5e-3)
    return Link(
        name, arm, f'level_{name}', 'continuous', (length, 0.0, 0.0), variable=variable, factor=-1.0, boxes=(bar,)
    )


def _four_dof(machine):
    built = _built(machine)
    marks = built.marks
    x_offset, y_offset = (built.dx, 0.0, 0.0), (0.0, built.dy, 0.0)
    swivel = (Box((9e-3, 9e-3, 9e-3), (0.0, 0.0, 5e-3), _DARK),)
    legs = [(_bar(_X, 0.0, length, 6e-3, 6e-3, _ORANGE),) for length in (built.k10, built.k12)]
    return [
        _slider('d1', _X, marks.d1),
        _slider('d3', _X, marks.d3),
        _slider('d5', _Y, marks.d5),
        _slider('d7', _Y, marks.d7),
        _arm('link_2', 'slider_d1', 'th2', built.l2),
        _arm('link_4', 'slider_d3', 'th4', built.l4),
        _arm('link_6', 'slider_d5', 'th6', built.l6),
        _arm('link_8', 'slider_d7', 'th8', built.l8),
        _platform('platform_p', 'link_2', 'th2', built.l2, _Y, built.dy),
        _platform('platform_q', 'link_8', 'th8', built.l8, _X, built.dx),
        Link('link_9', 'platform_p', 'phi', 'continuous', y_offset, variable='phi', boxes=swivel),
        Link('link_11', 'platform_q', 'turn_q', 'continuous', x_offset, variable='phi', boxes=swivel),
        Link('link_10', 'link_9', 'theta10', 'continuous', yaw=math.pi, axis=_UP, variable='theta10', boxes=legs[0]),
        Link('link_12', 'link_11', 'theta12', 'continuous', axis=_UP, variable='theta12', boxes=legs[1]),
        Link(
            'end_effector',
            'link_10',
            'level_end_effector',
            'continuous',
            (built.k10, 0.0, 0.0),
            axis=_UP,
            variable='theta10',
            factor=-1.0,
            boxes=(Box((26e-3, 14e-3, 6e-3), (0.0, 0.0, 3e-3), _GREEN),),
        ),
        Link(TOOL, 'end_effector', TOOL, 'fixed', (0.0, 0.0, built.dz), yaw=math.pi),
    ]


def _planar(machine):
    built = _built(machine)
    marks = built.marks
    return [
        _slider('d1', _X, marks.d1),
        _slider('d3', _X, marks.d3),
        _arm('link_2', 'slider_d1', 'th2', built.l2),
        _arm('link_4', 'slider_d3', 'th4', built.l4),
        _platform('platform_p', 'link_2', 'th2', built.l2, _Y, built.dy),
        Link(TOOL, 'platform_p', TOOL, 'fixed', (0.0, built.dy, 0.0)),
    ]


def _xy_stage(machine):
    low, high = machine.limits.lower[1] - 20e-3, machine.limits.upper[1] + 20e-3
    carriage = (_slider('x', _X).boxes[0], _bar(_Y, float(low), float(high), 14e-3, 6e-3, _STEEL, z=-1e-3))
    table = (Box((24e-3, 24e-3, 8e-3), (0.0, 0.0, 6e-3), _GREEN),)
    return [
        Link('carriage_x', ROOT, 'x', 'prismatic', axis=_X, variable='x', boxes=carriage),
        Link('table', 'carriage_x', 'y', 'prismatic', axis=_Y, variable='y', boxes=table),
        Link(TOOL, 'table', TOOL, 'fixed'),
    ]


_DESCRIPTIONS = {'four_dof': _four_dof, 'planar': _planar, 'xy_stage': _xy_stage}
