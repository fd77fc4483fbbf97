"""Transforms from each link of pkm_core.machines.description to its parent, all at once."""

import numpy as np

from pkm_core.machines.description import joint_positions, links, local_frame

# numbers of a transform: translation x, y, z [m], then the quaternion x, y, z, w
SIZE = 7


class LinkTransforms:
    """
    The transforms of the links of `machine` to their parents.

    A sliding link has a translation that is linear in its joint, a turning one a quaternion that is linear in cosine
    and sine of half its joint. All transforms are one product of a matrix with these, in microseconds.

    Attributes
    ----------
    moving : tuple of Link
        Links that move in their parent, in the order of `at`.
    fixed : tuple of Link
        Links that do not.

    """

    def __init__(self, machine):
        described = links(machine)
        self.moving = tuple(link for link in described if link.variable)
        self.fixed = tuple(link for link in described if not link.variable)
        self._names = tuple(joint_positions(machine, machine.home))
        zero = dict.fromkeys(self._names, 0.0)
        self._constant = np.concatenate([transform(link, zero) for link in self.moving])
        count = len(self._names)
        self._rates = np.zeros((self._constant.size, 3 * count))  # of position, cosine and sine of half of it
        for row, link in enumerate(self.moving):
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
        return self._constant + self._rates @ np.concatenate([q, np.cos(half), np.sin(half)])


def transform(link, positions):
    """Return the numbers (7,) of `link` at `positions`."""
    (w, x, y, z), origin = local_frame(link, positions)
    return np.array([*origin, x, y, z, w])
