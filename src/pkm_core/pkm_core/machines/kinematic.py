"""
Machines without masses: the modules and layouts of chapter 2 that were not built, for design tools only.

A `linkage` is one planar module, a `layout` two T-mechanisms with a vertical one. A cell, a simulation and a learning
law need dynamics and refuse them.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from pkm_core.config import Angle, Config, Length
from pkm_core.errors import ConfigError, WorkspaceError
from pkm_core.jet import stack
from pkm_core.machines.base import JointConfig, Machine, MachineConfig, PositiveLength
from pkm_core.machines.guided_pair import SIDES, check_pair, guided_pair
from pkm_core.machines.layout_core import LayoutCore
from pkm_core.machines.t_mechanism import check_travel


class GuideConfig(Config):
    """One straight guide in the base frame."""

    x: Annotated[Length, Field(description='of the zero of its scale')]
    y: Annotated[Length, Field(description='of the zero of its scale')]
    direction: Annotated[Angle, Field(description='of increasing readings, from +X about +Z')]


class SidedGuideConfig(GuideConfig):
    """One straight guide with a T-mechanism beside it."""

    side: Annotated[Literal['left', 'right'], Field(description='of the guide on which the joint is')]


class LinkageJoints(Config):
    """Travel of the sliders."""

    d1: JointConfig
    d3: JointConfig


class LayoutJoints(LinkageJoints):
    """Travel of the sliders."""

    d5: JointConfig
    d7: JointConfig


class LinkageGuides(Config):
    """The guide of each slider."""

    d1: GuideConfig
    d3: GuideConfig


class LayoutGuides(Config):
    """The guide of P, with d1 and d3, and the guide of Q, with d7 and d5."""

    p: SidedGuideConfig
    q: SidedGuideConfig


class LinkageGeometry(Config):
    """Length l2 of both links, the side of the joint, and whether a bar across both guides carries the end-effector."""

    l2: PositiveLength
    side: Annotated[Literal['left', 'right'], Field(description='of the line from d1 to d3 on which the joint is')]
    bar: Annotated[bool, Field(description='guide rail of an H-linkage, which moves with the joint')]


class LayoutGeometry(Config):
    """Lengths l2 of links 2, 4, 6, 8 and k10 of links 10, 12; offsets dy of P, dx of Q, dz of the end-effector."""

    l2: PositiveLength
    k10: PositiveLength
    dx: Length
    dy: Length
    dz: Length


class LinkageConfig(MachineConfig):
    """A planar module of two sliders on two guides; kinematics only."""

    mechanism: Literal['linkage']
    joints: LinkageJoints
    guides: LinkageGuides
    geometry: LinkageGeometry

    @model_validator(mode='after')
    def _travel_stays_regular(self):
        travel = (self.joints.d1, self.joints.d3)
        check_pair(self.pair(), [each.lower for each in travel], [each.upper for each in travel], ('d1', 'd3'))
        return self

    def pair(self):
        """Return the `GuidedPair`; ValueError if the links do not reach at home."""
        guides = (self.guides.d1, self.guides.d3)
        home = [self.joints.d1.home, self.joints.d3.home]
        origins = [(guide.x, guide.y) for guide in guides]
        return _reaching(origins, [guide.direction for guide in guides], self.geometry, self.geometry.side, home, 0.0)


class LayoutConfig(MachineConfig):
    """Two T-mechanisms on any two guides and a vertical one on both; kinematics only."""

    mechanism: Literal['layout']
    joints: LayoutJoints
    guides: LayoutGuides
    geometry: LayoutGeometry

    @model_validator(mode='after')
    def _travel_stays_regular(self):
        check_travel(self.joints, 'd1', 'd3', self.geometry.l2)
        check_travel(self.joints, 'd7', 'd5', self.geometry.l2)
        core = self.core()
        ends = [np.array([[j.lower, j.home, j.upper] for j in pair]) for pair in (self._p, self._q)]
        P, Q = (
            np.stack(pair.place(np.stack(np.meshgrid(*each, indexing='ij'), axis=-1).reshape(-1, 2)))
            for pair, each in zip((core.p, core.q), ends, strict=True)
        )
        w = Q[:, None, :] - P[:, :, None]
        ahead = float((np.cos(core.heading) * w[0] + np.sin(core.heading) * w[1]).min())
        longest = float(np.hypot(*w).max())
        if not ahead > 0.0 or not longest < 2.0 * core.k10:
            raise ValueError(
                f'guides: PQ in the travel is {1e3 * ahead:.4g} mm along its direction at home, at most '
                f'{1e3 * longest:.4g} mm long; allowed above 0 mm, below 2 k10 = {2e3 * core.k10:g} mm'
            )
        return self

    @property
    def _p(self):
        return self.joints.d1, self.joints.d3

    @property
    def _q(self):
        return self.joints.d7, self.joints.d5

    def core(self):
        """Return the `LayoutCore`; ValueError if the links do not reach at home."""
        geometry = self.geometry
        pairs = []
        for guide, joints, offset in (
            (self.guides.p, self._p, geometry.dy),
            (self.guides.q, self._q, geometry.dx),
        ):
            origins, directions = [(guide.x, guide.y)] * 2, [guide.direction] * 2
            home = [joint.home for joint in joints]
            pairs.append(_reaching(origins, directions, geometry, guide.side, home, offset))
        homes = [np.array([joint.home for joint in joints]) for joints in (self._p, self._q)]
        P, Q = (np.array(pair.place(home)) for pair, home in zip(pairs, homes, strict=True))
        return LayoutCore(*pairs, geometry.k10, geometry.dz, float(np.arctan2(*(Q - P)[::-1])))


def _reaching(origins, directions, geometry, side, home, offset):
    assert side in SIDES
    try:
        return guided_pair(origins, directions, geometry.l2, side, home, offset)
    except WorkspaceError as error:
        raise ValueError(f'geometry.l2: at home: {error}') from None


class KinematicMachine(Machine):
    """A machine of this module: everything but dynamics, which it refuses with `ConfigError`."""

    def dynamic_parameters(self):
        """Refuse: `ConfigError`."""
        raise ConfigError(
            f'{self.name}: a {self.config.mechanism} has kinematics only, without masses, motions and gains; expected '
            f'a machine with dynamics: four_dof, planar or xy_stage. Design verbs such as pkm layouts accept it'
        )

    def _terms(self, q, qd):
        return self.dynamic_parameters()

    def passive_angles(self, q):
        """Return {}: the angles of the links are not named."""
        return {}


class Linkage(KinematicMachine):
    """One planar module; q = [d1, d3], x = [x, y] of the joint."""

    Config = LinkageConfig
    joints = ('d1', 'd3')
    coordinates = ('x', 'y')

    def __init__(self, config, name, configuration=None):
        super().__init__(config, name, configuration)
        self.pair = config.pair()

    def forward(self, q):
        """Return (x, y) of the joint at `q`; see `Machine.forward`."""
        return stack(list(self.pair.place(self._joints(q))))

    def inverse(self, x):
        """Return (d1, d3) at the pose `x`; see `Machine.inverse`."""
        x = self._pose(x)
        return stack(list(self.pair.sliders(x[..., 0], x[..., 1])))

    def jacobian(self, q):
        """Return J (..., 2, 2); see `Machine.jacobian`."""
        return self.pair.rates(self._joints(q))[0]

    def singularity_margin(self, q):
        """Return `GuidedPair.margin` (...,) [m]."""
        return self.pair.margin(self._joints(q))


class Layout(KinematicMachine):
    """Two T-mechanisms and a vertical one; q = [d1, d3, d5, d7], x = [x, y, z, phi]."""

    Config = LayoutConfig
    joints = ('d1', 'd3', 'd5', 'd7')
    coordinates = ('x', 'y', 'z', 'phi')

    def __init__(self, config, name, configuration=None):
        super().__init__(config, name, configuration)
        self.core = config.core()

    def forward(self, q):
        """Return (x, y, z, phi) at `q`; see `Machine.forward`."""
        return self.core.forward(self._joints(q)[..., CORE_ORDER])

    def inverse(self, x):
        """Return (d1, d3, d5, d7) at the pose `x`; see `Machine.inverse`."""
        return self.core.inverse(self._pose(x))[..., CORE_ORDER]

    def jacobian(self, q):
        """Return J (..., 4, 4); see `Machine.jacobian`."""
        return self.core.rates(self._joints(q)[..., CORE_ORDER])[0][..., CORE_ORDER]

    def singularity_margin(self, q):
        """Return the least distance (...,) [m] of the three T-mechanisms from their singularities, as a four_dof."""
        q, core = self._joints(q)[..., CORE_ORDER], self.core
        P, Q = (np.stack(p.place(part), axis=-1) for p, part in ((core.p, q[..., :2]), (core.q, q[..., 2:])))
        distance = np.linalg.norm(Q - P, axis=-1)
        flat = np.minimum(distance, 2.0 * core.k10 - distance)
        return np.minimum(flat, np.minimum(core.p.margin(q[..., :2]), core.q.margin(q[..., 2:])))


CORE_ORDER = np.array([0, 1, 3, 2])  # d1, d3, d7, d5: the lower slider first; its own inverse
