"""Uncertainty of measured lengths: section `built.uncertainty` of a machine file, as written by a calibration."""

from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError, WrapValidator, model_validator

from pkm_core.config import Config, Length, Number, quantity
from pkm_core.machines.real_geometry import printed_unit, si_unit

_DIGITS = 9  # of a correlation; errors of 1e-9 of (10 um)^2 are far below the variance of a pose, (0.1 um)^2
_ROUNDING = 1e-7  # of an eigenvalue of the correlations, by these digits
_TYPES = {unit: TypeAdapter(quantity(unit)) for unit in ('rad', '')}


class _Converted(float):
    """A deviation that is no length, in SI."""


def _convert(deviations, info):
    """Return the `deviations` of a file; those that are no lengths are converted to SI, by the unit of their name."""
    if not isinstance(deviations, dict):
        return deviations  # refused by its type
    found = dict(deviations)
    for name, deviation in deviations.items():
        unit = si_unit(str(name))
        if unit != 'm':
            try:
                found[name] = _Converted(_TYPES[unit].validate_python(deviation, context=info.context))
            except ValidationError as error:
                raise ValueError(f'{name}: {error.errors()[0]["msg"]}') from None
            if found[name] < 0.0:
                raise ValueError(f'{name} {found[name]:g} {unit or "1"} given; allowed from 0')
    return found


def _unless_converted(value, handler):
    return float(value) if isinstance(value, _Converted) else handler(value)


class Uncertainty(Config):
    """Standard deviations of measured errors, and their correlations: most errors compensate each other."""

    deviations: Annotated[
        dict[str, Annotated[Length, Field(ge=0), WrapValidator(_unless_converted)]],
        BeforeValidator(_convert),
        Field(description='standard deviation of each length and mark, and of each error of section geometry'),
    ]
    correlations: Annotated[
        tuple[tuple[Annotated[Number, Field(ge=-1, le=1)], ...], ...],
        Field(description='correlations of each but the first with those before it, one row each'),
    ]

    @model_validator(mode='after')
    def _correlations_fit(self):
        sizes, count = [len(row) for row in self.correlations], len(self.deviations)
        if sizes != list(range(1, count)):
            raise ValueError(
                f'correlations in rows of {sizes}; expected {list(range(1, count))}, as of {count} deviations'
            )
        least = float(np.linalg.eigvalsh(self._correlation()).min(initial=1.0))
        if least < -_ROUNDING:
            raise ValueError(f'correlations contradict each other: eigenvalue {least:.3g}; allowed from 0')
        return self

    @property
    def covariance(self):
        """Covariance (p, p) [m^2, rad^2, ...] of the errors in the order of `deviations`."""
        deviations = np.array(list(self.deviations.values()))
        return self._correlation() * np.outer(deviations, deviations)

    def _correlation(self):
        matrix = np.eye(len(self.deviations))
        for number, row in enumerate(self.correlations, start=1):
            matrix[number, :number] = matrix[:number, number] = row
        return matrix

    @classmethod
    def of(cls, names, covariance):
        """Return the uncertainty of `names` with the `covariance` (p, p) [m^2]."""
        deviations = np.sqrt(np.diag(covariance))
        scale = np.where(deviations > 0.0, deviations, 1.0)
        rows = (covariance / np.outer(scale, scale)).clip(-1.0, 1.0).round(_DIGITS).tolist()
        return cls(
            deviations=dict(zip(names, deviations.tolist(), strict=True)),
            correlations=tuple(tuple(row[:number]) for number, row in enumerate(rows) if number),
        )

    def lines(self, indent):
        """Return the lines of the section `uncertainty` in a machine file."""
        units = {name: printed_unit(name) for name in self.deviations}
        named = ', '.join(f'{name}: {units[name][0] * d:.6f} {units[name][1]}' for name, d in self.deviations.items())
        rows = [f'{indent}    - [{", ".join(f"{value:.{_DIGITS}f}" for value in row)}]' for row in self.correlations]
        return [
            f'{indent}uncertainty:  # of these values',
            f'{indent}  deviations: {{{named}}}',
            f'{indent}  correlations:  # of each but the first with those before it',
            *rows,
        ]
