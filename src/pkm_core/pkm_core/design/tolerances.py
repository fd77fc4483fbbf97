"""Tolerances of the machines in an error budget: models of config/design/tolerances.yaml."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from pkm_core.config import Config, Length, find_config, load_config, quantity


def _spread(unit):
    """Return the model of a random error in `unit`."""

    class Spread(Config):
        """One random error: `normal` with this standard deviation, or `uniform` with this half width."""

        normal: Annotated[quantity(unit), Field(ge=0.0, description='standard deviation')] | None = None
        uniform: Annotated[quantity(unit), Field(ge=0.0, description='half width')] | None = None

        @model_validator(mode='after')
        def _one_of_them(self):
            if (self.normal is None) == (self.uniform is None):
                raise ValueError('expected exactly one of normal and uniform')
            return self

        @property
        def deviation(self):
            """Standard deviation."""
            return self.normal if self.uniform is None else self.uniform / math.sqrt(3.0)

        def draw(self, generator, size):
            """Return an array of independent errors of shape `size`."""
            if self.normal is not None:
                return self.normal * generator.standard_normal(size)
            assert self.uniform is not None  # see _one_of_them
            return generator.uniform(-self.uniform, self.uniform, size)

    return Spread


LengthSpread, TorqueSpread, TemperatureSpread = (_spread(unit) for unit in ('m', 'N m', 'K'))
AngleSpread, NumberSpread = (_spread(unit) for unit in ('rad', ''))
Expansion = Annotated[quantity('1/K'), Field(ge=0.0)]


class BeltTolerances(Config):
    """Belts of the platforms: stiffness and load torque."""

    stiffness: Annotated[quantity('N m/rad'), Field(gt=0.0)]
    torque: TorqueSpread


class ThermalTolerances(Config):
    """Coefficients of expansion, and deviations of the temperatures from that of calibration."""

    links_expand: Expansion
    links_warm: TemperatureSpread
    scales_expand: Expansion
    scales_warm: TemperatureSpread


class GeometryTolerances(Config):
    """Guides, scales and laser axes; names as in machines/real_geometry.py, `tilt` is pitch and roll."""

    scale: NumberSpread
    square: AngleSpread
    tilt: AngleSpread
    height: LengthSpread
    straightness: Annotated[LengthSpread, Field(description='longest wave of a guide; wave k has 1/k^2 of it')]
    laser_axes: AngleSpread


class JointClearance(Config):
    """Play of the joints at the ends of the links."""

    single_dof: Annotated[Length, Field(ge=0.0, description='revolute joint, as built')]
    multi_dof: Annotated[Length, Field(ge=0.0, description='universal or ball joint, for comparison')]


class Tolerances(Config):
    """Spreads of all sources of end-point error; the rounding of the encoders is a property of the machine."""

    links: LengthSpread
    offsets: LengthSpread
    encoder_offsets: LengthSpread
    belts: BeltTolerances
    thermal: ThermalTolerances
    geometry: GeometryTolerances | None = None
    joint_clearance: JointClearance | None = None


def load_tolerances(name_or_path='tolerances') -> Tolerances:
    """
    Return the `Tolerances` of config/design/NAME.yaml or of a path; `ConfigError` if they are refused.

    Examples
    --------
    >>> round(1e6 * load_tolerances().links.deviation, 6)  # um
    10.0

    """
    return load_config(find_config('design', name_or_path), Tolerances)
