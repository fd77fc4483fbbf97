"""
Conventional stacked XY stage, the reference of the thesis: the pose is q = [x, y]; the X axis carries the Y axis.

Source: Tables 7.4, 7.5.
"""

from typing import Literal

import numpy as np
from pydantic import model_validator

from pkm_core.config import Config
from pkm_core.machines.base import Compiled, JointConfig, Machine, MachineConfig, PositiveMass


class XyStageJoints(Config):
    """Travel of the two axes."""

    x: JointConfig
    y: JointConfig


class XyStageMasses(Config):
    """Mass moved by each axis: `mx` includes the whole Y axis."""

    mx: PositiveMass
    my: PositiveMass

    @model_validator(mode='after')
    def _x_carries_y(self):
        if not self.my < self.mx:
            raise ValueError(f'my {self.my:g} kg; the X axis carries the Y axis: allowed 0 to mx {self.mx:g} kg')
        return self


class XyStageConfig(MachineConfig):
    """Nominal design of the stage."""

    mechanism: Literal['xy_stage']
    joints: XyStageJoints
    masses: XyStageMasses


class XyStage(Machine):
    """The machine of this module; forward and inverse are the identity: no pose is out of reach or singular."""

    Config = XyStageConfig
    joints = coordinates = ('x', 'y')
    parameters = Compiled('XY_STAGE_PARAMETERS')
    terms = Compiled('xy_stage_terms')
    rows = Compiled('xy_stage_rows')

    def forward(self, q):
        """Return a copy of `q`; see `Machine.forward`."""
        return 1.0 * self._joints(q)

    def inverse(self, x):
        """Return a copy of `x`; see `Machine.inverse`."""
        return 1.0 * self._pose(x)

    def jacobian(self, q):
        """Return the identity (..., 2, 2); see `Machine.jacobian`."""
        return np.broadcast_to(np.eye(2), (*self._joints(q).shape, 2)).copy()

    def singularity_margin(self, q):
        """Return infinity (...,): there is no singular position."""
        return np.full(self._joints(q).shape[:-1], np.inf)

    def passive_angles(self, q):
        """Return {}: there are no passive joints."""
        return {}

    def dynamic_parameters(self):
        """Return p as `dynamics.XY_STAGE_PARAMETERS`; see `Machine.dynamic_parameters`."""
        return np.array([self.config.masses.mx, self.config.masses.my])
