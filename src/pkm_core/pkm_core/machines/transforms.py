"""Transforms from each link of pkm_core.machines.description to its parent, all at once."""

import math

import numpy as np

from pkm_core.machines.description import frames, joint_positions, links, local_frame, moved, product

# numbers of a transform: translation x, y, z [m], then the quaternion x, y, z, w
SIZE = 7


class LinkTransforms:
    """
    The transforms of the links of `machine` to their parents.

    A sliding link has a translation that is linear in its joint, a turning one a quaternion that is linear in cosine
    and sine of half its joint. All transforms are one product of a matrix with these, in microseconds.

    The tree of links has the measured lengths and marks of a calibrated machine, not the guides of its section
    `built.geometry`. With such a section `tool0` moves in its parent, so that it has the pose of `Machine.forward`.

    Attributes
    ----------
    moving : tuple of Link
        Links that move in their parent, in the order of `at`.
    fixed : tuple of Link
        Links that do not.

    """

    def __init__(self, machine):
        self._machine, self._links = machine, links(machine)
        turning, still = (tuple(link for link in self._links if bool(link.variable) is kind) for kind in (True, False))
        self._corrects_tool = getattr(getattr(machine.config, 'built', None), 'geometry', None) is not None
        self.moving, self.fixed = (turning + still, ()) if self._corrects_tool else (turning, still)
        self._names = tuple(joint_positions(machine, machine.home))
        zero = dict.fromkeys(self._names, 0.0)
        self._constant = np.concatenate([transform(link, zero) for link in turning])
        count = len(self._names)
        self._rates = np.zeros((self._constant.size, 3 * count))  # of position, cosine and sine of half of it
        for row, link in enumerate(turning):
            of_link, column = slice(SIZE * row, SIZE * row + SIZE), self._names.index(link.variable)
            at_zero = transform(link, zero)
            if link.kind == 'prismatic':
                self._rates[of_link, column] = transform(link, zero | {link.variable: 1.0}) - at_zero
                continue
            at_half_turn = transform(link, zero | {link.variable: np.pi / link.factor})  # cosine 0, sine 1
            turn = slice(SIZE * row + 3, SIZE * row + SIZE)
            self._constant[turn] = 0.0
            self._rates[turn, count + column] = at_zero[3:]
            self._rates[turn, 2 * count + column] = np.sign(link.factor) * at_half_turn[3:]

    def at(self, positions):
        """Return the numbers (7 per link of `moving`,) at `positions` of `joint_positions`; `KeyError` without one."""
        q = np.array([positions[name] for name in self._names])
        half = 0.5 * q
        numbers = self._constant + self._rates @ np.concatenate([q, np.cos(half), np.sin(half)])
        return np.concatenate([numbers, self._tool_at(positions)]) if self._corrects_tool else numbers

    def _tool_at(self, positions):
        """Return the numbers (7,) of the last link, whose frame has the pose."""
        machine = self._machine
        q = [positions[joint] for joint in machine.joints]
        pose = dict(zip(machine.coordinates, machine.forward(q).tolist(), strict=True))
        (w, x, y, z), origin = frames(self._links, positions)[self._links[-1].parent]
        back, half = (w, -x, -y, -z), 0.5 * pose.get('phi', 0.0)
        offset = [pose.get(name, 0.0) - start for name, start in zip('xyz', origin, strict=True)]
        w, x, y, z = product(back, (math.cos(half), 0.0, 0.0, math.sin(half)))
        return np.array([*moved(back, (0.0, 0.0, 0.0), offset), x, y, z, w])


def transform(link, positions):
    """Return the numbers (7,) of `link` at `positions`."""
    (w, x, y, z), origin = local_frame(link, positions)
    return np.array([*origin, x, y, z, w])
