"""
The parallel machines as free bodies with joints, for joint forces: places, velocities, accelerations, joint axes.

Heights: all guides, horizontal links, P and Q are drawn in the plane z = 0, so that the moments are those about the
points of the kinematic model. Belts transmit a couple only; their pretension is not modelled.
Source: thesis ch. 5, the bodies of (5.2)-(5.21).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pkm_core.errors import PkmError
from pkm_core.jet import Jet, stack

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Body:
    """One rigid body over T samples; angular momentum about the centre is I (w - rod (rod . w)), rod a unit vector."""

    name: str
    mass: float
    place: np.ndarray  # (T, 3) of the centre of mass [m]
    velocity: np.ndarray  # (T, 3)
    acceleration: np.ndarray  # (T, 3)
    spin: np.ndarray  # (T, 3) w [rad/s]
    torque: np.ndarray  # (T, 3) rate of the angular momentum [N m]


@dataclass(frozen=True)
class Joint:
    """
    One joint between body `first` and body `second`; None is the base.

    `acting` are the components with a reaction, of three forces and three moments along `axes`. The first axis is that
    of a revolute joint, or of a guide, whose force along it is the thrust of its motor.
    """

    name: str
    kind: str  # 'guide', 'revolute' or 'belt'
    first: int | None
    second: int
    place: np.ndarray  # (T, 3)
    axes: np.ndarray  # (T, 3, 3), rows
    acting: tuple[int, ...]  # of the six components


def bodies_and_joints(machine, q, qd, qdd):
    """
    Return ([Body], [Joint]) of `machine` along the motion `q`, `qd`, `qdd` (T, n) [m, m/s, m/s^2].

    Raises
    ------
    PkmError
        If the machine is not a planar or four_dof.

    """
    mechanism = machine.config.mechanism
    if mechanism not in ('planar', 'four_dof'):
        raise PkmError(f'{machine.name}: a {mechanism} has no joints with modelled forces; expected planar or four_dof')
    return _Assembly(machine, Jet.from_derivatives(q, qd, qdd, np.zeros_like(q))).build()


class _Assembly:
    """Collects bodies and joints; positions and angles are Jets."""

    def __init__(self, machine, q):
        self._config, self._joints, self._q = machine.config, machine.joints, q
        self._angles = machine.passive_angles(q)
        self._bodies, self._found = [], []

    def build(self):
        """Return the bodies and the joints."""
        geometry, masses = self._config.geometry, self._config.masses
        platform_p, P = self._pair('1234', 0.0, 'p', geometry.dy, masses.mp)
        if self._config.mechanism == 'four_dof':
            # d7 is the lower slider on the guide of Y
            platform_q, Q = self._pair('7856', 0.5 * np.pi, 'q', geometry.dx, masses.mq)
            self._vertical(platform_p, P, platform_q, Q)
        return self._bodies, self._found

    def _pair(self, numbers, guide, platform, offset, mass):
        """Add two sliders, two links and a platform; return the index of the platform and its point (x, y)."""
        geometry, masses, inertias = self._config.geometry, self._config.masses, self._config.inertias
        along = np.array([np.cos(guide), np.sin(guide), 0.0]).round(15)
        across = np.array([along[1], along[0], 0.0])  # +Y for the guide of X, +X for that of Y
        sliders: list[int] = []
        links: list[int] = []
        tip: list[Any] = []
        for slider, link in ((numbers[0], numbers[1]), (numbers[2], numbers[3])):
            d = self._q[..., self._joints.index(f'd{slider}')]
            place = [d * along[0], d * along[1]]
            angle, r = self._angles[f'th{link}'], getattr(geometry, f'r{link}')
            sliders.append(self._body(f'slider d{slider}', getattr(masses, f'm{slider}'), place, 0.0 * d))
            self._joint(f'guide d{slider}', 'guide', None, sliders[-1], place, (along, across, _UP), range(6))
            cos, sin = np.cos(angle), np.sin(angle)
            centre = [place[0] + r * cos, place[1] + r * sin]
            inertia = getattr(inertias, f'I{link}')
            links.append(self._body(f'link {link}', getattr(masses, f'm{link}'), centre, 0.0 * d, angle, inertia))
            self._revolute(f'd{slider} - link {link}', sliders[-1], links[-1], place)
            if not tip:
                tip = [place[0] + geometry.l2 * cos, place[1] + geometry.l2 * sin]
        at = [tip[0] + offset * across[0], tip[1] + offset * across[1]]
        top = self._body(f'platform {platform}', mass, at, 0.0 * at[0])
        for link, number in zip(links, (numbers[1], numbers[3]), strict=True):
            self._revolute(f'link {number} - platform {platform}', link, top, tip)
        self._joint(f'belt {platform}', 'belt', sliders[0], top, at, (_UP, along, across), (3,))
        return top, at

    def _vertical(self, platform_p, P, platform_q, Q):
        """Add links 9 to 12 and the end-effector on two platforms."""
        geometry, masses, inertias = self._config.geometry, self._config.masses, self._config.inertias
        phi, slender = self._angles['phi'], inertias.rods_about_vertical == 'slender'
        # phi is the direction from Q to P
        ahead = [-1.0 * np.cos(phi), -1.0 * np.sin(phi)]
        normal = _vectors(stack([-1.0 * ahead[1], ahead[0], 0.0 * phi]))[0]
        axes = (normal, _UP, np.cross(normal, _UP))
        foot = [0.5 * (P[0] + Q[0]), 0.5 * (P[1] + Q[1])]
        Z = geometry.k10 * np.sin(self._angles['theta10'])
        tool = self._body('end-effector', masses.mef, foot, Z, phi, inertias.Ief)
        for number, post, platform, base, sign in (('10', '9', platform_p, P, 1.0), ('12', '11', platform_q, Q, -1.0)):
            r, elevation = getattr(geometry, f'r{number}'), self._angles[f'theta{number}']
            rise = [sign * np.cos(elevation) * part for part in ahead] + [np.sin(elevation)]
            centre = [base[i] + r * rise[i] for i in range(2)]
            carrier = self._body(
                f'link {post}', getattr(masses, f'm{post}'), base, 0.0 * phi, phi, getattr(inertias, f'I{post}')
            )
            rod = self._body(
                f'link {number}', getattr(masses, f'm{number}'), centre, r * rise[2], phi,
                getattr(inertias, f'I{number}'), turn=(normal, -sign * _rate(elevation), elevation, sign),
                rod=stack(rise) if slender else None,
            )  # fmt: skip
            self._revolute(f'platform {"p" if number == "10" else "q"} - link {post}', platform, carrier, base)
            self._joint(f'link {post} - link {number}', 'revolute', carrier, rod, base, axes, (0, 1, 2, 4, 5))
            self._joint(f'link {number} - end-effector', 'revolute', rod, tool, foot, axes, (0, 1, 2, 4, 5), Z)
            if number == '10':
                self._joint('belt of the end-effector', 'belt', carrier, tool, foot, axes, (3,), Z)

    def _revolute(self, name, first, second, place):
        self._joint(name, 'revolute', first, second, place, (_UP, np.array([1.0, 0, 0]), np.array([0, 1.0, 0])),
                    (0, 1, 2, 4, 5))  # fmt: skip

    def _joint(self, name, kind, first, second, place, axes, acting, height=None):
        point = _vectors(stack([*place, 0.0 * place[0] if height is None else height]))[0]
        rows = np.stack([np.broadcast_to(axis, point.shape) for axis in axes], axis=-2)
        self._found.append(Joint(name, kind, first, second, point, rows, tuple(acting)))

    def _body(self, name, mass, place, height, angle=None, inertia=0.0, turn=None, rod=None):
        x, v, a = _vectors(stack([*place, height]))
        spin, torque = np.zeros_like(x), np.zeros_like(x)
        if angle is not None:
            _, rate, bend, _ = angle.derivatives()
            spin, change = rate[:, None] * _UP, bend[:, None] * _UP
            if turn is not None:
                normal, lift, elevation, sign = turn
                spin = spin + lift[:, None] * normal
                change = change - sign * elevation.derivatives()[2][:, None] * normal
                change = change + (lift * rate)[:, None] * np.cross(_UP, normal)  # the axis turns with phi
            torque = inertia * change
            if rod is not None:
                r, rd, _ = _vectors(rod)
                along, along_rate = (np.sum(p * o, axis=1)[:, None] for p, o in ((r, spin), (r, change)))
                along_rate = along_rate + np.sum(rd * spin, axis=1)[:, None]
                torque = torque - inertia * (rd * along + r * along_rate)
        self._bodies.append(Body(name, mass, x, v, a, spin, torque))
        return len(self._bodies) - 1


def _vectors(jet):
    """Return position, velocity, acceleration (T, 3) of a Jet of vectors."""
    return jet.derivatives()[:3]


def _rate(jet) -> Any:
    return jet.derivatives()[1]
