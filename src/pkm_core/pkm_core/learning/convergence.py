"""
Convergence test of a learning law before its use: factor of the error per cycle, over frequency and perturbed models.

From U <- M U + gain A E and E = E0 - G U the distance to the fixed point becomes M - gain A G times that of the
previous cycle. A law passes if, at its largest gain, the factor is below 1 on all `perturbed_models` (gain +-20 %,
resonances +-5 %, both sides of the zeros). Smaller gains then pass too: the factor is convex in the gain, and |M| <= 1
at gain 0.
"""

from dataclasses import dataclass

import numpy as np

from pkm_core.control.margins import perturbed_models, unit_circle
from pkm_core.control.model import AxisModel
from pkm_core.control.systems import plant_system
from pkm_core.errors import LearningError
from pkm_core.learning.law import path_through

STEP = 1.0  # [Hz] of the test; the sharpest mode is 9 Hz wide
SLOWEST = 0.2  # [Hz] first harmonic of a cycle of 5 s


@dataclass(frozen=True)
class Convergence:
    """Factor of one joint's error from cycle to cycle; the unperturbed model is the first."""

    models: tuple[AxisModel, ...]
    frequency: np.ndarray  # (F,) [Hz]
    factor: np.ndarray  # (models, F) at the law's largest gain

    @property
    def worst(self):
        """The largest factor."""
        return float(self.factor.max())

    @property
    def worst_frequency(self):
        """Frequency of the largest factor [Hz]."""
        return float(self.frequency[self.factor.max(axis=0).argmax()])

    @property
    def worst_model(self):
        """The model with the largest factor, as text."""
        model, nominal = self.models[self.factor.max(axis=1).argmax()], self.models[0]
        if not model.modes:
            return f'gain {model.gain / nominal.gain - 1:+.0%}'
        shift = model.modes[0].resonance / nominal.modes[0].resonance - 1
        sides = ''.join('R' if mode.antiresonance_damping < 0 else 'L' for mode in model.modes)  # of the plane
        return f'gain {model.gain / nominal.gain - 1:+.0%}, modes {shift:+.0%}, zeros {sides}'


def convergence(law, joint):
    """Return the `Convergence` of `law` on `joint`."""
    sample_time = law.machine.sample_time
    frequency = np.concatenate([[SLOWEST, 0.5], np.arange(STEP, law.config.band.fall_to + STEP, STEP)])
    z = unit_circle(frequency, sample_time)
    models = perturbed_models(law.models[joint], uncertainty=law.gains[joint].uncertainty)
    memory, action = law.memory(joint, frequency), law.action(joint, frequency)
    gain = max(law.config.gain)
    plants = {}  # by modes, for gain 1
    factor = []
    for model in models:
        if model.modes not in plants:
            plants[model.modes] = plant_system(model, sample_time)(z) / model.gain
        path = path_through(law.gains[joint], model.gain * plants[model.modes], z, sample_time)
        factor.append(np.abs(memory - gain * action * path))
    return Convergence(tuple(models), frequency, np.array(factor))


def checked(name, law):
    """
    Return `law`, named `name`, with its `verdict`.

    Raises
    ------
    LearningError
        If it diverges on a joint; the message has factor, frequency and model.

    """
    found = {joint: convergence(law, joint) for joint in law.gains}
    joint = max(found, key=lambda each: found[each].worst)
    worst = found[joint]
    verdict = (
        f'the error of {joint} at {worst.worst_frequency:.1f} Hz is multiplied by {worst.worst:.3f} per cycle '
        f'({worst.worst_model})'
    )
    if not worst.worst < 1:
        raise LearningError(f'learning law {name!r} would diverge: {verdict}; allowed below 1')
    law.verdict = f'learning law {name!r} converges: at worst {verdict}'
    return law
