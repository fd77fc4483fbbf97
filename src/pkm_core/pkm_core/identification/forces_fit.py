"""
Fit of the forces on a slider (control/forces.py) to records of moves, after K, a and H are known.

The model does not explain e = y - P u, the position less that of the model. Each force is a column: its voltage, passed
through the model from the slider to the encoder. Columns and e are weighted by (s/(s + w0))^2, about the sensitivity of
a loop, which removes drift, and low-passed below the modes. Least squares gives the parameters. The travel over which
friction reverses and the pitch of the magnets enter nonlinearly; both are scanned. The measured voltage contains every
feedforward in use, so a machine with identified forces can be identified again.

The friction state follows the measured position, low-passed, with a dead band for noise at rest.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from pkm_core.control.forces import friction_course
from pkm_core.control.model import Forces
from pkm_core.identification.partial_fractions import PartialFractions

_CORNER = 50.0  # [Hz] w0/(2 pi); about the bandwidth of the loops
_BAND = (140.0, 200.0)  # [Hz] low-pass, below the modes
_SMOOTH = (100.0, 160.0)  # [Hz] low-pass of the position for the friction state
_PLAY = 0.5e-6  # [m] dead band: 2.5 counts of 0.2 um; noise within it does not move the slider
_SLIPS = np.array([4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24, 28, 33, 40]) * 1e-6  # [m]
_PITCHES = np.arange(12.0, 61.0) * 1e-3  # [m]
_STEPS = np.linspace(-0.75e-3, 0.75e-3, 7)  # [m] refinement of the best pitch
_MARGIN = 20  # [samples] left out at the ends of a record
_BEFORE, _BEHIND = 20, 60  # [samples] of rest used around the moves
_BLOCKS = 10  # of the jackknife
_USEFUL = 0.9  # largest rms with ripple and cogging over that without; above it both are left out
_NAMES = ('coulomb', 'ripple_sine', 'ripple_cosine', 'cogging_sine', 'cogging_cosine')


@dataclass(frozen=True)
class ForcesFit:
    """Fitted forces; `deviations` has one standard deviation of each fitted parameter, by name."""

    forces: Forces
    deviations: dict[str, float]
    residual: float  # [m] rms of the weighted position error with the forces
    unexplained: float  # [m] the same without them


def fit_forces(records, low, known):
    """
    Return the `ForcesFit` to a list of `AxisData`, or None if there is no motion in both directions.

    Parameters
    ----------
    records : sequence of AxisData
        Moves in closed loop that end where they begin, at rest.
    low : LowFrequencyFit
        K and a.
    known : KnownDynamics
        Current loop, dead time and H.

    """
    if not np.isfinite(low.friction):
        return None
    axes = [_Weighted(data, low, known) for data in records]
    target = np.concatenate([axis.target for axis in axes])
    fits = [(_solve(_columns(axes, length, None), target), length) for length in _SLIPS]
    (rms, theta, _), slip = min(fits, key=lambda each: each[0][0])
    columns, pitch = _columns(axes, slip, None), None
    if max(np.ptp(axis.position) for axis in axes) > _PITCHES[0]:
        found = _scan_pitch(axes, slip, target)
        if found[0] <= _USEFUL * rms:
            _, pitch = found
            fits = [(_solve(_columns(axes, length, pitch), target), length) for length in _SLIPS]
            (rms, theta, _), slip = min(fits, key=lambda each: each[0][0])
            columns = _columns(axes, slip, pitch)
    deviations = _jackknife(columns, target)
    values = dict(zip(_NAMES, theta[2:], strict=False))
    values['coulomb'] = max(values['coulomb'], 0.0)
    shape = {} if pitch is None else {'pitch': float(pitch)}
    return ForcesFit(
        Forces(slip=float(slip), coupling=1.0, **shape, **{name: float(value) for name, value in values.items()}),
        dict(zip(_NAMES, deviations[2:].tolist(), strict=False)),
        float(rms),
        float(_solve(columns[:, :2], target)[0]),
    )


class _Weighted:
    """One record: its signals, and the weighted response of the position to a voltage at the slider."""

    def __init__(self, data, low, known):
        self.voltage, self.gain, self.viscosity = data.voltage, low.gain, low.viscosity
        self.position = data.position
        samples, time = len(data.position), data.sample_time
        f = np.fft.rfftfreq(samples, time)
        f[0] = 1e-3 * f[1]  # P has no value at 0 Hz; the weight is 0 there
        s = 2j * np.pi * f
        z = np.exp(s * time)
        fall = np.clip((f - _BAND[0]) / (_BAND[1] - _BAND[0]), 0, 1)
        weight = (s / (s + 2 * np.pi * _CORNER)) ** 2 * 0.5 * (1 + np.cos(np.pi * fall))
        drive = PartialFractions.of(low.viscosity, known.corner, known.modes)
        force = PartialFractions.of(low.viscosity, np.inf, known.modes)
        whole, rest = divmod(max(known.delay, 0.0), time)
        plant = low.gain * drive.sampled(z, time, rest) * z ** -(data.computation + whole)
        self._path = low.gain * force.at(s) * weight
        reaction = np.zeros(samples) if data.reaction is None else data.reaction
        y = np.fft.rfft(data.position - data.position[0]) - plant * np.fft.rfft(data.voltage)
        self.used = self._used(data, samples)
        self.target = np.fft.irfft(y * weight + self._path * np.fft.rfft(reaction), samples)[self.used]
        velocity = np.gradient(data.reference, time)
        self.own = (np.gradient(velocity, time) + low.viscosity * velocity) / low.gain
        self.speed = low.viscosity * velocity / low.gain
        self.still = _play(_low_passed(data.position, f), _PLAY)

    @staticmethod
    def _used(data, samples):
        begin, end = _MARGIN, samples - _MARGIN
        if data.moves:
            begin = max(begin, data.moves[0][0] - _BEFORE)
            end = min(end, data.moves[-1][1] + _BEHIND)
        return slice(begin, end)

    def through(self, voltage):
        """Return the weighted position [m] of a `voltage` (N,) at the slider, in the samples that are used."""
        return np.fft.irfft(np.fft.rfft(voltage) * self._path, len(voltage))[self.used]


def _columns(axes, slip, pitch):
    """Return the columns (N, k): errors of K and a, then friction and, with a `pitch`, ripple and cogging."""
    blocks = []
    for axis in axes:
        end = friction_course(axis.still, 0.0, slip)[-1]
        shapes = [axis.own, axis.speed, -friction_course(axis.still, end, slip)]
        if pitch is not None:
            angle = 2 * np.pi * axis.position / pitch
            shapes += [axis.voltage * np.sin(angle), axis.voltage * np.cos(angle), np.sin(2 * angle), np.cos(2 * angle)]
        blocks.append(np.column_stack([axis.through(shape) for shape in shapes]))
    return np.concatenate(blocks)


def _scan_pitch(axes, slip, target):
    """Return (rms, pitch) of the best pitch, to a quarter of a millimetre."""

    def best(pitches):
        return min((_solve(_columns(axes, slip, pitch), target)[0], pitch) for pitch in pitches)

    _, coarse = best(_PITCHES)
    return best(coarse + _STEPS)


def _solve(columns, target):
    """Return rms of the residual, parameters, residual."""
    theta = np.linalg.lstsq(columns, target, rcond=None)[0]
    residual = target - columns @ theta
    return float(np.sqrt(np.mean(residual**2))), theta, residual


def _jackknife(columns, target):
    """Return the standard deviation of each parameter from the scatter of fits without one of _BLOCKS blocks."""
    parts = np.array_split(np.arange(len(target)), _BLOCKS)
    grams = np.array([columns[part].T @ columns[part] for part in parts])
    sides = np.array([columns[part].T @ target[part] for part in parts])
    fits = np.array(
        [np.linalg.solve(grams.sum(0) - gram, sides.sum(0) - side) for gram, side in zip(grams, sides, strict=True)]
    )
    return np.sqrt((_BLOCKS - 1) / _BLOCKS * np.sum((fits - fits.mean(0)) ** 2, axis=0))


def _low_passed(position, frequency):
    fall = np.clip((frequency - _SMOOTH[0]) / (_SMOOTH[1] - _SMOOTH[0]), 0, 1)
    spectrum = np.fft.rfft(position - position[0]) * 0.5 * (1 + np.cos(np.pi * fall))
    return position[0] + np.fft.irfft(spectrum, len(position))


@njit(cache=True)
def _play(position, half):
    """Return `position` (N,) behind a backlash of +-`half` [m]."""
    behind, z = np.empty(position.size), position[0]
    for k in range(position.size):
        z = min(max(z, position[k] - half), position[k] + half)
        behind[k] = z
    return behind
