"""
Planar 2-DOF manipulator: sliders d1, d3 on one guide along X carry a T-mechanism; the pose is its point P = (x, y).

A belt, assumed ideal, prevents rotation of the small platform at P.
Source: thesis ch. 2, (2.4)-(2.12); ch. 7, (7.1)-(7.12); Table 6.1.
"""

from typing import Literal

import numpy as np
from pydantic import model_validator

from pkm_core.config import Config, Length
from pkm_core.jet import stack, value
from pkm_core.machines.base import (
    Compiled,
    JointConfig,
    Machine,
    MachineConfig,
    NotNegativeLength,
    PositiveInertia,
    PositiveLength,
    PositiveMass,
)
from pkm_core.machines.built import PlanarBuilt
from pkm_core.machines.checks import check_between
from pkm_core.machines.real_geometry import RealKinematics
from pkm_core.machines.t_mechanism import check_centres, check_travel, joint_place, joint_rates, margins


class PlanarJoints(Config):
    """Travel of the sliders."""

    d1: JointConfig
    d3: JointConfig


class PlanarGeometry(Config):
    """Length l2 of links 2 and 4, offset dy of P, centres of mass r2, r4 from the slider pivot."""

    l2: PositiveLength
    dy: Length
    r2: NotNegativeLength
    r4: NotNegativeLength

    @model_validator(mode='after')
    def _centres_lie_on_links(self):
        check_centres(self, ('r2', 'r4'), 'l2')
        return self


class PlanarMasses(Config):
    """Sliders m1, m3; links m2, m4; platform mp."""

    m1: PositiveMass
    m2: PositiveMass
    m3: PositiveMass
    m4: PositiveMass
    mp: PositiveMass


class PlanarInertias(Config):
    """Links 2 and 4 about their centre of mass."""

    I2: PositiveInertia
    I4: PositiveInertia


class PlanarConfig(MachineConfig):
    """Nominal design of the planar manipulator."""

    mechanism: Literal['planar']
    joints: PlanarJoints
    geometry: PlanarGeometry
    masses: PlanarMasses
    inertias: PlanarInertias
    built: PlanarBuilt | None = None

    @model_validator(mode='after')
    def _travel_stays_regular(self):
        check_travel(self.joints, 'd1', 'd3', self.geometry.l2)
        return self

    @model_validator(mode='after')
    def _built_is_close_to_the_drawing(self):
        if self.built is not None:
            self.built.check(self.geometry)
        return self


class Planar(Machine):
    """The machine of this module; q = [d1, d3], encoder readings of the built machine, x = [x, y]."""

    Config = PlanarConfig
    Built = PlanarBuilt
    joints = ('d1', 'd3')
    coordinates = ('x', 'y')
    parameters = Compiled('PLANAR_PARAMETERS')
    terms = Compiled('planar_terms')
    rows = Compiled('planar_rows')

    def __init__(self, config, name, configuration=None):
        super().__init__(config, name, configuration)
        self._built = config.built or PlanarBuilt.as_drawn(config.geometry)
        self._marks = np.array([self._built.marks.d1, self._built.marks.d3])
        self._real = None
        if self._built.geometry is not None:
            self._real = RealKinematics(config.mechanism, self._built, self.limits, (self._forward, self._inverse))

    def forward(self, q):
        """Return (x1, y1) of (2.5), (2.6) at `q`; see `Machine.forward`."""
        closed = self._forward(q)
        return closed if self._real is None else self._real.forward(self._joints(q))

    def _forward(self, q):
        d1, _, along, Y1 = self._linkage(q)
        return stack([d1 + along, Y1 + self._built.dy])

    def inverse(self, x):
        """Return (d1, d3) of (2.11), (2.12) at the pose `x`; see `Machine.inverse`."""
        x = self._pose(x)
        return self._inverse(x) if self._real is None else self._real.inverse(x)

    def _inverse(self, x):
        l2, l4, dy = self._built.l2, self._built.l4, self._built.dy
        check_between(value(x)[..., 1:], dy, dy + min(l2, l4), ('y',), 'reach of links 2 and 4 (2.10)')
        Y1 = x[..., 1] - dy
        below, above = np.sqrt(l2 * l2 - Y1 * Y1), np.sqrt(l4 * l4 - Y1 * Y1)
        return stack([x[..., 0] - below, x[..., 0] + above]) + self._marks

    def jacobian(self, q):
        """Return J (..., 2, 2) [m/m] of (3.16); see `Machine.jacobian`."""
        if self._real is not None:
            self._forward(q)  # raises out of reach
            return self._real.jacobian(q)
        _, gap, along, Y1 = self._linkage(q)
        moves, sinks = joint_rates(gap, along, Y1)
        return np.stack([np.stack([1.0 - moves, moves], axis=-1), np.stack([-sinks, sinks], axis=-1)], axis=-2)

    def singularity_margin(self, q):
        """Return the change (...,) [m] of the gap d3 - d1 that leads to (3.27) or (3.29), the lesser one."""
        _, gap, _, _ = self._linkage(q)
        return margins(gap, self._built.l2, self._built.l4)

    def passive_angles(self, q):
        """Return {'th2', 'th4'}: directions (...,) [rad] of links 2, 4 from their slider, from +X about +Z; (7.4)."""
        _, gap, along, Y1 = self._linkage(q)
        return {'th2': np.arctan(Y1 / along), 'th4': np.pi - np.arctan(Y1 / (gap - along))}

    def dynamic_parameters(self):
        """Return p as `dynamics.PLANAR_PARAMETERS`; see `Machine.dynamic_parameters`."""
        config = self.config
        numbers = {**dict(config.geometry), **dict(config.masses), **dict(config.inertias)}
        return np.array([numbers[name] for name in self.parameters])

    def _linkage(self, q):
        """Return d1, the gap of the sliders, the joint's distance along the guide from d1 and over it; (...,) [m]."""
        q = self._joints(q) - self._marks
        gap = q[..., 1] - q[..., 0]
        along, Y1 = joint_place(gap[..., None], self._built.l2, self._built.l4, ('d3 - d1',))
        return q[..., 0], gap, along[..., 0], Y1[..., 0]
