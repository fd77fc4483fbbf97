"""The operational workspace W and the designs compared in chapter 4: models of config/design/NAME.yaml."""

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from pkm_core.config import Angle, Config, Length, find_config, load_config
from pkm_core.design.error_matrix import Geometry
from pkm_core.machines.base import PositiveLength


class _Span(Config):
    first: float
    last: float
    points: Annotated[int, Field(ge=1, le=1000)]

    @model_validator(mode='after')
    def _rises(self):
        if self.points > 1 and not self.first < self.last:
            raise ValueError(f'first {self.first:g} is not below last {self.last:g} (SI)')
        if self.points == 1 and self.first != self.last:
            raise ValueError(f'one point, but first {self.first:g} and last {self.last:g} differ (SI)')
        return self

    def values(self):
        """Return the points (n,), evenly from first to last."""
        return np.linspace(self.first, self.last, self.points)


class LengthSpan(_Span):
    """Evenly spaced lengths."""

    first: Length
    last: Length


class AngleSpan(_Span):
    """Evenly spaced angles."""

    first: Angle
    last: Angle


class Grid(Config):
    """Poses of W: every combination of the coordinates."""

    x: LengthSpan
    y: LengthSpan
    z: LengthSpan
    phi: AngleSpan

    def poses(self):
        """Return all poses (N, 4) [m, rad]."""
        return self._combine(self.phi.values())

    def poses_at_middle_angle(self):
        """Return the poses (N, 4) [m, rad] at the middle angle."""
        angles = self.phi.values()
        return self._combine(angles[len(angles) // 2 : len(angles) // 2 + 1])

    def _combine(self, angles):
        axes = (self.x.values(), self.y.values(), self.z.values(), angles)
        return np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, 4)


class Offsets(Config):
    """Offsets of P, Q and the end-effector in W."""

    dx: Length
    dy: Length
    dz: Length


class Design(Config):
    """Lengths l of links 2 to 8 and k of links 10 and 12."""

    l: Annotated[PositiveLength, Field(description='of links 2 to 8')]  # noqa: E741 - the thesis's symbol
    k: Annotated[PositiveLength, Field(description='of links 10 and 12')]


class Range(Config):
    """Allowed lengths of a search."""

    lower: PositiveLength
    upper: PositiveLength

    @model_validator(mode='after')
    def _rises(self):
        if not self.lower < self.upper:
            raise ValueError(f'lower {1e3 * self.lower:g} mm is not below upper {1e3 * self.upper:g} mm')
        return self


class Bounds(Config):
    """Ranges of l and k."""

    l: Annotated[Range, Field(description='of links 2 to 8')]  # noqa: E741 - the thesis's symbol
    k: Annotated[Range, Field(description='of links 10 and 12')]


class OperationalWorkspace(Config):
    """Contents of a file of config/design; `geometry` combines it with the lengths of a design."""

    workspace: Grid
    offsets: Offsets
    initial: Design
    bounds: Bounds
    pareto: Bounds

    def geometry(self, l2, k10):
        """Return the `Geometry` of the lengths `l2`, `k10` [m], numbers or arrays, with the offsets of W."""
        return Geometry(l2, k10, self.offsets.dx, self.offsets.dy, self.offsets.dz)


def load_operational_workspace(name_or_path='chapter4') -> OperationalWorkspace:
    """
    Return the `OperationalWorkspace` of config/design/NAME.yaml or of a path; raise `ConfigError` if it is invalid.

    Examples
    --------
    >>> load_operational_workspace('chapter4').workspace.poses().shape
    (432, 4)

    """
    return load_config(find_config('design', name_or_path), OperationalWorkspace)
