"""Stability margins of one axis, (7.26)-(7.29): of its model, of perturbed models, and of a measured response."""

from dataclasses import dataclass, fields, replace
from itertools import product

import numpy as np

from pkm_core.control.nyquist import FIGURES, loop_figures
from pkm_core.control.systems import open_loop, plant_system
from pkm_core.control.uncertainty import UNIDENTIFIED
from pkm_core.errors import PkmError

_OF_MOTION = ('gain_reduction', 'crossover', 'bandwidth', 'bandwidth_3db', 'tracking_bandwidth')  # of a moving axis


@dataclass(frozen=True)
class Margins:
    """
    Stability margins of a loop; without `stable` the other figures have no meaning.

    S = 1/(1 + L), T = 1 - S. nan: the response does not reach the level.
    """

    gain_margin: float  # [dB] allowed increase of the gain (7.26)
    gain_reduction: float  # [dB] allowed decrease; with integral action a loop may need a minimum gain
    phase_margin: float  # [deg] (7.27)
    peak_sensitivity: float  # max |S|
    disk_margin: float  # a: gain times (2 + a)/(2 - a) or its inverse, and phase 2 atan(a/2), are allowed together
    crossover: float  # [Hz] highest frequency with |L| = 1
    bandwidth: float  # [Hz] up to which |S| < 1, CLBW of (7.29)
    bandwidth_3db: float  # [Hz] up to which |S| < 1/sqrt 2
    tracking_bandwidth: float  # [Hz] from which on |T| < 1/sqrt 2
    slowest_pole: float  # largest |z| of the closed loop; nan for a measured response

    @property
    def stable(self):
        """Whether the closed loop is stable."""
        return self.slowest_pole < 1


def design_grid(sample_time):
    """Return the frequencies [Hz] at which models are evaluated; the sharpest mode is 9 Hz wide."""
    nyquist = 0.5 / sample_time
    return np.concatenate([[0.2, 0.5], np.arange(1.0, nyquist, 0.25), [nyquist]])


def unit_circle(frequency, sample_time):
    """Return z = exp(j w Ts)."""
    return np.exp(2j * np.pi * np.asarray(frequency) * sample_time)


def stability_margins(gains, model, sample_time):
    """Return the `Margins` of a `PidLaw` on an `AxisModel`."""
    frequency = design_grid(sample_time)
    z = unit_circle(frequency, sample_time)
    loop = gains.response(z, sample_time) * plant_system(model, sample_time)(z)
    return _margins(frequency, loop, _slowest_pole(gains, model, sample_time))


def measured_margins(frequency, loop):
    """
    Return the `Margins` of a measured open loop `loop` (m,) at rising `frequency` (m,) [Hz].

    They are valid within the measured band only and do not include stability. For a measured plant P [m/V], which
    includes computation delay and hold, the loop is ``gains.response(unit_circle(frequency, Ts), Ts) * P``.

    Raises
    ------
    PkmError
        If the shapes differ, a value is not finite or the frequencies do not rise.

    """
    frequency, loop = np.asarray(frequency, dtype=np.float64), np.asarray(loop, dtype=np.complex128)
    if frequency.ndim != 1 or frequency.size < 2 or loop.shape != frequency.shape:
        raise PkmError(f'response: frequency {frequency.shape}, loop {loop.shape}; expected two equal (m,), m >= 2')
    if not (np.isfinite(loop).all() and np.isfinite(frequency).all() and (np.diff(frequency) > 0).all()):
        raise PkmError('response: expected finite values at rising frequencies')
    return _margins(frequency, loop, np.nan)


def perturbed_models(model, gains=None, uncertainty=UNIDENTIFIED):
    """
    Return models within the `Uncertainty` of `model`, `model` itself first; `gains` replaces its factors of the gain.

    `UNIDENTIFIED`: gain +-20 %, all modes shifted by +-5 %, and both signs of the damping of every anti-resonance: the
    printed models of the thesis do not show on which side of the imaginary axis the zeros are, and a change of pose can
    move them across. `IDENTIFIED`: gain +-10 %, modes +-3 %.
    """
    signs_of_zeros = product((1, -1) if uncertainty.both_signs else (1,), repeat=len(model.modes))
    return [
        model.model_copy(
            update={
                'gain': model.gain * gain,
                'modes': tuple(_shifted(mode, shift, sign) for mode, sign in zip(model.modes, signs, strict=True)),
            }
        )
        for signs in signs_of_zeros
        for shift in uncertainty.resonances
        for gain in (uncertainty.gains if gains is None else gains)
    ]


def is_guide_known(model):
    """Return whether the model has identified friction, and with it the spring of a guide at rest."""
    return model.forces is not None and model.forces.coulomb > 0


def worst_margins(gains, model, sample_time):
    """
    Return the `Margins` with each figure the worst over `perturbed_models` and, with `forces`, the stuck guide.

    The models are those of the `uncertainty` of the law `gains`.
    """
    frequency = design_grid(sample_time)
    z = unit_circle(frequency, sample_time)
    controller, found = gains.response(z, sample_time), []
    for shape in perturbed_models(model, (1.0,), gains.uncertainty):
        loop = controller * plant_system(shape, sample_time)(z)
        for gain in gains.uncertainty.gains:
            pole = _slowest_pole(gains, shape.model_copy(update={'gain': gain * model.gain}), sample_time)
            found.append(_margins(frequency, gain * loop, pole))
    if is_guide_known(model):
        plant = plant_system(model, sample_time, stuck=True)
        law, response = gains.system(sample_time), plant(z)
        for gain in gains.uncertainty.gains:
            poles = law.then(replace(plant, C=gain * plant.C)).closed_loop_poles()
            stuck = _margins(frequency, gain * controller * response, float(np.abs(poles).max()))
            # crossover and bandwidth are those of a moving axis: on its spring the axis follows the integrator
            found.append(replace(stuck, **{name: getattr(found[0], name) for name in _OF_MOTION}))
    highest = ('peak_sensitivity', 'slowest_pole')
    return Margins(**{
        field.name: float((np.max if field.name in highest else np.min)([getattr(each, field.name) for each in found]))
        for field in fields(Margins)
    })  # fmt: skip


def require_stable(where, gains, model, sample_time):
    """Raise `PkmError`, beginning with `where`, if the loop of the `PidLaw` `gains` on `model` is unstable."""
    pole = _slowest_pole(gains, model, sample_time)
    if pole >= 1:
        margins = stability_margins(gains, model, sample_time)
        excess = f', gain margin {-margins.gain_reduction:.1f} dB' if np.isfinite(margins.gain_reduction) else ''
        raise PkmError(f'{where}: the loop is unstable: slowest pole |z| = {pole:.4f}; allowed below 1{excess}')


def require_stable_set(where, gains, model, sample_time):
    """Raise `PkmError`, beginning with `where`, unless the loop is stable on all `perturbed_models` of its law."""
    require_stable(where, gains, model, sample_time)
    for each in perturbed_models(model, uncertainty=gains.uncertainty):
        pole = _slowest_pole(gains, each, sample_time)
        if pole >= 1:
            shift = each.modes[0].resonance / model.modes[0].resonance - 1 if model.modes else 0.0
            raise PkmError(
                f'{where}: the loop is unstable within the uncertainty of its model, at gain '
                f'{each.gain / model.gain - 1:+.0%} and modes {shift:+.0%}: slowest pole |z| = {pole:.4f}; allowed '
                'below 1'
            )


def require_margins(where, gains, model, sample_time, *, gain_margin, phase_margin):
    """
    Raise `PkmError`, beginning with `where`, if the loop of `gains` on `model` is unstable or a margin is too small.

    `gain_margin` [dB] is the least allowed increase and decrease of the gain, `phase_margin` [deg] that of the phase.
    """
    require_stable(where, gains, model, sample_time)
    margins = stability_margins(gains, model, sample_time)
    lacking = [
        f'{name} {value:.1f} {unit}, allowed from {least:g}'
        for name, value, least, unit in (
            ('gain margin', margins.gain_margin, gain_margin, 'dB'),
            ('gain reduction', margins.gain_reduction, gain_margin, 'dB'),
            ('phase margin', margins.phase_margin, phase_margin, 'deg'),
        )
        if not value >= least
    ]
    if lacking:
        raise PkmError(f'{where}: the loop has {"; ".join(lacking)}')


def _slowest_pole(gains, model, sample_time):
    return float(np.abs(open_loop(gains, model, sample_time).closed_loop_poles()).max())


def _margins(frequency, loop, slowest_pole):
    figures = np.empty(len(FIGURES))
    loop_figures(frequency, loop, 1.0, 0.0, figures)
    return Margins(*figures[1:].tolist(), slowest_pole)


def _shifted(mode, shift, sign):
    return mode.model_copy(
        update={
            'resonance': mode.resonance * shift,
            'antiresonance': mode.antiresonance * shift,
            'antiresonance_damping': mode.antiresonance_damping * sign,
        }
    )
