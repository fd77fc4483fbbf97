"""Verification of a calibration: prediction errors by the laser at poses that were not used, before and after."""

from typing import NamedTuple

import numpy as np

from pkm_core.design.calibration import prediction_errors
from pkm_core.design.units import units
from pkm_core.errors import PkmError

FEWEST_HELD = 4  # poses; below, the mean that removes the datum hides the errors
_BY_NOISE = 1.5  # deviations of a reading; an error below is that of the laser, not of the machine


class Verification(NamedTuple):
    """Errors (m,) [m, rad] of the end point at held-out poses, measured by the laser, less their mean."""

    coordinates: tuple[str, ...]
    poses: int
    noise: np.ndarray  # (m,) standard deviation of a measurement
    before: np.ndarray  # (m,) root mean square with the machine in use before
    after: np.ndarray  # (m,) with the calibrated machine
    before_largest: np.ndarray  # (m,)
    after_largest: np.ndarray  # (m,)

    @property
    def worse(self):
        """Names of the coordinates whose error grows and exceeds the noise of the laser."""
        grown = (self.after > self.before) & (self.after > _BY_NOISE * self.noise)
        return tuple(name for name, each in zip(self.coordinates, grown, strict=True) if each)

    @property
    def better(self):
        """Names of the coordinates whose error shrinks."""
        shrunk = self.after < self.before
        return tuple(name for name, each in zip(self.coordinates, shrunk, strict=True) if each)

    @property
    def accepted(self):
        """Whether no coordinate is worse."""
        return not self.worse

    def reasons(self, machine):
        """Return one text per coordinate that is worse, for a refusal."""
        texts = []
        for i, (name, (factor, unit)) in enumerate(zip(self.coordinates, units(machine), strict=True)):
            if name in self.worse:
                texts.append(
                    f'{name}: error at {self.poses} other poses {factor * self.after[i]:.3f} {unit}; allowed '
                    f'{factor * max(self.before[i], _BY_NOISE * self.noise[i]):.3f} {unit}, that before the calibration'
                )
        return texts


def verify(machine_before, calibrated, measurements_held, deviation):
    """
    Return the `Verification` of the machine `calibrated` against `machine_before` on `measurements_held`.

    `deviation` (m,) is that of the held-out measurements. `PkmError` if there are fewer than FEWEST_HELD poses.
    """
    if len(measurements_held.q) < FEWEST_HELD:
        raise PkmError(f'verification: {len(measurements_held.q)} poses; allowed from {FEWEST_HELD}')
    before, after = (prediction_errors(machine.forward, measurements_held) for machine in (machine_before, calibrated))
    return Verification(
        machine_before.coordinates,
        len(before),
        np.asarray(deviation),
        *(np.sqrt(np.mean(errors**2, axis=0)) for errors in (before, after)),
        *(np.abs(errors).max(axis=0) for errors in (before, after)),
    )
