"""Identification of one axis from its records: L, then H given L, then L again given H."""

from dataclasses import dataclass, replace

import numpy as np
from pydantic import ValidationError

from pkm_core.config_errors import allowed
from pkm_core.control.model import AxisModel, Mode
from pkm_core.identification import IdentificationError
from pkm_core.identification.axis_data import AxisData, joint_number
from pkm_core.identification.coupling import coupling_factor
from pkm_core.identification.forces_fit import ForcesFit, fit_forces
from pkm_core.identification.frequency_fit import (
    MISFIT,
    HighFrequencyFit,
    Surroundings,
    fit_high_frequency,
    response_fit_percent,
)
from pkm_core.identification.frequency_response import FrequencyResponse, estimate_response
from pkm_core.identification.prediction import KnownDynamics
from pkm_core.identification.prediction_error import LowFrequencyFit, fit_low_frequency

# [s] of the current loop: measured -8.72 deg at 1 kHz (Fig. 6.10), of which its lag at 7.42 kHz is -7.68 deg
LOOP_DELAY = 2.9e-6
_MODES = 2  # (7.20) of the thesis's machines: 4th order
_ROUNDS = 2  # L and H depend on each other; the second round changes K by 1e-4
# thresholds of warnings
_POOR_FIT = 90.0  # per cent
_GAINS_DIFFER = 0.05
_TIMES_DIFFER = 0.01


@dataclass(frozen=True)
class AxisIdentification:
    """Result of the identification of one axis."""

    joint: str
    moves: tuple[AxisData, ...]  # records of the fit of L
    low: LowFrequencyFit
    low_known: KnownDynamics
    responses: tuple[FrequencyResponse, ...]  # one per position; () without a sweep
    high: HighFrequencyFit | None
    high_known: Surroundings | None
    high_percent: float  # lowest fit of a held-out response [%]; nan with a single response
    lowest: int | None  # index of the response with the lowest initial gain, the design case of the thesis (7.3.2)
    warnings: tuple[str, ...]
    forces: ForcesFit | None = None  # of `identify_joint`, if it has moves in both directions

    def model(self, current_loop):
        """
        Return the `AxisModel`; `current_loop` [Hz] is the corner of the current loop used in the fit.

        Raises
        ------
        IdentificationError
            If a fitted value is outside the range that `AxisModel` allows.

        """
        rows = [] if self.high is None else self.high.modes.tolist()
        names = ('resonance', 'resonance_damping', 'antiresonance', 'antiresonance_damping')
        try:
            modes = tuple(Mode(**dict(zip(names, row, strict=True))) for row in rows)
            return AxisModel(
                gain=self.low.gain,
                viscosity=self.low.viscosity,
                current_loop=current_loop,
                modes=modes,
                forces=None if self.forces is None else self.forces.forces,
            )
        except ValidationError as error:
            first = error.errors()[0]
            key = '.'.join(map(str, first['loc']))
            raise IdentificationError(
                f'{self.joint}: {key} is {first["input"]}; allowed {allowed(first, AxisModel)}'
            ) from None


def identify_joint(machine, joint, records, models, gains, *, band=None, modes=None):
    """
    Return the `AxisIdentification` of a joint of `machine` from `JointRecord` objects.

    H is fitted to records with an excitation of the joint, L to records in which it moves without any excitation.

    Parameters
    ----------
    machine : Machine
        Machine of the joint.
    joint : str
        Name of the joint.
    records : sequence of JointRecord
        Experiments of any joints, or ordinary cycles.
    models : dict of str to AxisModel
        Present models: the current loop and number of modes of this joint, the coupling of the others.
    gains : dict of str to RobustGains
        Gains during the experiments; they enter the coupling.
    band : (float, float), optional
        Band of the sweep [Hz].
    modes : int, optional
        Number of resonances; by default that of the joint's model, or two if the model has none.

    Raises
    ------
    IdentificationError
        If the joint never moves without excitation, or a fit refuses its data.

    """
    moves = [record.axis(machine, joint) for record in records if record.moves_plainly(machine, joint)]
    excited = [record for record in records if record.excites(machine, joint)]
    responses = [joint_response(machine, joint, record, models, gains, band=band) for record in excited]
    prior = models[joint]
    modes = modes or len(prior.modes) or _MODES
    found = identify_axis(joint, moves, responses, corner=prior.current_loop, delay=LOOP_DELAY, modes=modes)
    return replace(found, forces=fit_forces(moves, found.low, found.low_known))


def joint_response(machine, joint, record, models, gains, *, band=None):
    """
    Return the `FrequencyResponse` of a joint, corrected to the other joints held at home, from a `JointRecord`.

    Arguments as for `identify_joint`. The uncorrected response, with the others under their own control, is
    ``estimate_response(record.axis(machine, joint), band)``.
    """
    response = estimate_response(record.axis(machine, joint), band)
    axis, position = joint_number(machine, joint), record.excited_position()
    factor = coupling_factor(machine, axis, position, response.frequency, models, gains)
    return replace(response, plant=response.plant / factor, deviation=response.deviation / abs(factor))


def identify_axis(joint, moves, responses, *, corner=np.inf, delay=0.0, delay_deviation=2e-6, modes=_MODES):
    """
    Return the `AxisIdentification` from records of moves and, if any, measured responses of one axis.

    Parameters
    ----------
    joint : str
        Name of the axis in the result.
    moves : sequence of AxisData
        Records for L.
    responses : sequence of FrequencyResponse
        Responses for H; may be empty.
    corner : float
        Corner of the current loop [Hz].
    delay, delay_deviation : float
        Dead time beyond the computation and its standard deviation [s].
    modes : int
        Number of resonances.

    """
    if not moves:
        raise IdentificationError(f'{joint}: no record with moves without excitation; K and a are fitted to such moves')
    sample_time, computation = moves[0].sample_time, moves[0].computation
    for data in moves:
        if abs(data.sample_time / sample_time - 1) > _TIMES_DIFFER:
            raise IdentificationError(
                f'{data.name}: sample time {1e3 * data.sample_time:.4g} ms; {moves[0].name} has '
                f'{1e3 * sample_time:.4g} ms'
            )
    low_known, high_known, high, percent, lowest, notes = KnownDynamics(corner, delay), None, None, np.nan, None, []
    low = fit_low_frequency(moves, low_known)
    if responses:
        lowest = int(np.argmin([response.initial_gain() for response in responses]))
        for _ in range(_ROUNDS):
            high_known = Surroundings(low.viscosity, sample_time, corner, delay, delay_deviation, computation)
            high, notes = _fit_stations(responses, lowest, high_known, modes)
            notes = [*notes, *high.warnings]
            low_known = KnownDynamics(corner, high.delay, high.modes)
            low = fit_low_frequency(moves, low_known)
        percent = _left_out_percent(responses, high_known, modes)
        notes = [*notes, *_disagreements(joint, low, high, percent)]
    warnings = [f'{joint}: {text}' for text in low.warnings]
    warnings += [text for response in responses for text in response.warnings]
    return AxisIdentification(
        joint,
        tuple(moves),
        low,
        low_known,
        tuple(responses),
        high,
        high_known,
        percent,
        lowest,
        (*warnings, *notes),
    )


def _disagreements(joint, low, high, percent):
    sweep = high.gains.mean()
    differ = sweep / low.gain - 1
    if abs(differ) > _GAINS_DIFFER:
        yield (
            f'{joint}: the gain of the sweep is {sweep:.3f}, that of the moves {low.gain:.3f} m/s^2/V: difference '
            f'{100 * differ:+.1f} %; allowed {100 * _GAINS_DIFFER:g} %'
        )
    if percent < _POOR_FIT:
        yield f'{joint}: H fits a held-out response to {percent:.1f} %; expected {_POOR_FIT:g} %'


def _fit_stations(responses, lowest, known, modes):
    """Return (fit, warnings): the fit to all responses or, if modes move with position, to that of lowest gain."""
    together = fit_high_frequency(responses, known, modes)
    if len(responses) == 1 or together.misfit <= MISFIT:
        return together, []
    alone = [fit_high_frequency([response], known, modes) for response in responses]
    resonances = np.array([fit.modes[:, 0] for fit in alone])
    spread = np.ptp(resonances, axis=0) / resonances.mean(axis=0)
    note = (
        f'{responses[lowest].name}: no single H fits all positions (misfit {together.misfit:.1f}): resonances '
        f'move by {", ".join(f"{100 * each:.1f} %" for each in spread)}; H is that of the position of lowest gain'
    )
    return alone[lowest], [note]


def _left_out_percent(responses, known, modes):
    """Return the lowest fit [%] of one response to the model of the others."""
    percent = []
    for index, response in enumerate(responses):
        others = [each for number, each in enumerate(responses) if number != index]
        if others:
            fit = fit_high_frequency(others, known, modes)
            percent.append(response_fit_percent(response, known, fit, float(np.mean(fit.gains))))
    return min(percent, default=float('nan'))
