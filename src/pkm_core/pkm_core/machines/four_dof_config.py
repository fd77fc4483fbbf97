"""Models of config/machines/four_dof.yaml; link numbers as in the thesis (Table 6.1)."""

import math
from typing import Literal

from pydantic import model_validator

from pkm_core.config import Config, Length
from pkm_core.machines.base import (
    JointConfig,
    MachineConfig,
    NotNegativeLength,
    PositiveInertia,
    PositiveLength,
    PositiveMass,
)
from pkm_core.machines.built import FourDofBuilt
from pkm_core.machines.t_mechanism import check_centres, check_travel


class FourDofJoints(Config):
    """Travel of the sliders."""

    d1: JointConfig
    d3: JointConfig
    d5: JointConfig
    d7: JointConfig


class FourDofGeometry(Config):
    """
    Length l2 of links 2, 4, 6, 8 and k10 of links 10, 12; offsets dy of P, dx of Q, dz of the end-effector.

    Centres of mass: r2 to r8 from the slider pivot, r10, r12 from the lower pivot.
    """

    l2: PositiveLength
    k10: PositiveLength
    dx: Length
    dy: Length
    dz: Length
    r2: NotNegativeLength
    r4: NotNegativeLength
    r6: NotNegativeLength
    r8: NotNegativeLength
    r10: NotNegativeLength
    r12: NotNegativeLength

    @model_validator(mode='after')
    def _centres_lie_on_links(self):
        check_centres(self, ('r2', 'r4', 'r6', 'r8'), 'l2')
        check_centres(self, ('r10', 'r12'), 'k10')
        return self


class FourDofMasses(Config):
    """Sliders m1, m3, m5, m7; links m2 to m12; platforms mp, mq at P, Q; end-effector mef."""

    m1: PositiveMass
    m2: PositiveMass
    m3: PositiveMass
    m4: PositiveMass
    m5: PositiveMass
    m6: PositiveMass
    m7: PositiveMass
    m8: PositiveMass
    mp: PositiveMass
    mq: PositiveMass
    m9: PositiveMass
    m10: PositiveMass
    m11: PositiveMass
    m12: PositiveMass
    mef: PositiveMass


class FourDofInertias(Config):
    """
    Links about their centre of mass; links 9, 11 and the end-effector about the vertical.

    `rods_about_vertical` is the inertia of links 10, 12 about the vertical: I10, I12 at any elevation ('isotropic', as
    in the thesis) or that times the squared cosine of the elevation, as of thin rods ('slender').
    """

    I2: PositiveInertia
    I4: PositiveInertia
    I6: PositiveInertia
    I8: PositiveInertia
    I9: PositiveInertia
    I10: PositiveInertia
    I11: PositiveInertia
    I12: PositiveInertia
    Ief: PositiveInertia
    rods_about_vertical: Literal['isotropic', 'slender']


class FourDofConfig(MachineConfig):
    """Nominal design of the 4-DOF manipulator."""

    mechanism: Literal['four_dof']
    joints: FourDofJoints
    geometry: FourDofGeometry
    masses: FourDofMasses
    inertias: FourDofInertias
    built: FourDofBuilt | None = None

    @model_validator(mode='after')
    def _travel_stays_regular(self):
        joints, l2, k10 = self.joints, self.geometry.l2, self.geometry.k10
        check_travel(joints, 'd1', 'd3', l2)
        check_travel(joints, 'd7', 'd5', l2)
        # corners of the rectangles that P and Q can reach
        y1 = _heights_reached(joints.d1, joints.d3, l2, self.geometry.dy)
        x2 = _heights_reached(joints.d7, joints.d5, l2, self.geometry.dx)
        x1 = [0.5 * (getattr(joints.d1, end) + getattr(joints.d3, end)) for end in ('lower', 'upper')]
        y2 = [0.5 * (getattr(joints.d5, end) + getattr(joints.d7, end)) for end in ('lower', 'upper')]
        for name, least in (('x1 - x2', x1[0] - x2[1]), ('y2 - y1', y2[0] - y1[1])):
            if not least > 0.0:
                raise ValueError(f'joints: least {name} in the travel is {least * 1e3:g} mm; allowed above 0 mm (2.15)')
        longest = math.hypot(x1[1] - x2[0], y2[1] - y1[0])
        if not longest < 2.0 * k10:
            longest, bound = 1e3 * longest, 2e3 * k10
            raise ValueError(f'joints: largest PQ in the travel is {longest:g} mm; allowed below 2 k10 = {bound:g} mm')
        return self

    @model_validator(mode='after')
    def _built_is_close_to_the_drawing(self):
        if self.built is not None:
            self.built.check(self.geometry)
        return self


def _heights_reached(low, high, link, offset):
    """Return the least and the greatest height of the joint over two sliders, `offset` included [m]."""
    widest, narrowest = high.upper - low.lower, high.lower - low.upper
    return [math.sqrt(link * link - 0.25 * gap * gap) + offset for gap in (widest, narrowest)]
