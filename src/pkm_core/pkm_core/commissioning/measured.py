"""Loop of new gains with a measured response, and its margins."""

from dataclasses import dataclass

import numpy as np

from pkm_core.control.margins import design_grid, measured_margins, unit_circle
from pkm_core.control.systems import plant_system
from pkm_core.identification.frequency_fit import COHERENT


@dataclass(frozen=True)
class MeasuredResponse:
    """The response of one axis at one position of its motor pair, computation delay and hold included."""

    name: str
    position: float  # [m] mean position of the axis
    frequency: np.ndarray  # (F,) rising [Hz]
    plant: np.ndarray  # (F,) complex [m/V]
    coherence: np.ndarray  # (F,) between excitation and position

    @classmethod
    def of(cls, response):
        """Return the `MeasuredResponse` of a `FrequencyResponse`."""
        return cls(response.name, response.position, response.frequency, response.plant, response.coherence)


def measured_loop(gains, model, response, sample_time):
    """
    Return (frequency [Hz], L) from 0.2 Hz to the upper edge of the sweep.

    Measured lines with a coherence below COHERENT are left out. Below the sweep, where the crossover is, the model
    fitted to the moves is used. Above the sweep there are no data.
    """
    good = response.coherence >= COHERENT
    frequency, plant = response.frequency[good], response.plant[good]
    grid = design_grid(sample_time)
    below = grid[grid < response.frequency[0]]
    slow = plant_system(model, sample_time)(unit_circle(below, sample_time))
    frequency, plant = np.concatenate([below, frequency]), np.concatenate([slow, plant])
    return frequency, gains.response(unit_circle(frequency, sample_time), sample_time) * plant


def check_measured(joint, gains, model, responses, limits, sample_time):
    """
    Return {name of the response: Margins} and a list of the violated `LoopLimits` as texts.

    Use the limits for perturbed models: another position and an error of the fit are perturbations of the model.
    """
    found, reasons = {}, []
    for response in responses:
        margins = measured_margins(*measured_loop(gains, model, response, sample_time))
        found[response.name] = margins
        wanted = (
            ('gain margin', margins.gain_margin, limits.gain_margin, 'dB', 1),
            ('phase margin', margins.phase_margin, np.degrees(limits.phase_margin), 'deg', 1),
            ('peak sensitivity', margins.peak_sensitivity, limits.peak_sensitivity, '', -1),
        )
        reasons += [
            f'{joint}: {what} {value:.2f} {unit} on the response measured as {response.name}; allowed '
            f'{"from" if sign > 0 else "up to"} {limit:.3g} {unit}'
            for what, value, limit, unit, sign in wanted
            if not sign * value >= sign * limit
        ]
    return found, reasons
