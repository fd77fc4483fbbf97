"""Models of config/tuning: targets, limits, search range and search size of `pkm tune`."""

from typing import Annotated

from pydantic import Field, model_validator

from pkm_core.config import Angle, Config, Frequency, Number, find_config, load_config
from pkm_core.control.filters import Decibel


class Targets(Config):
    """Targets of the objective (7.30)."""

    gain_margin: Annotated[Decibel, Field(gt=0)]
    phase_margin: Annotated[Angle, Field(gt=0)]
    bandwidth: Annotated[Frequency, Field(gt=0, description='of the closed loop (CLBW)')]


class LoopLimits(Config):
    """Limits that a loop must satisfy."""

    gain_margin: Annotated[Decibel, Field(gt=0)]
    phase_margin: Annotated[Angle, Field(gt=0)]
    peak_sensitivity: Annotated[Number, Field(gt=1, description='largest |S|')]
    resonance_peak: Annotated[Number, Field(gt=0, description='largest |L| at the modes')]


class AllLimits(Config):
    """Limits for the model and for the perturbed models."""

    nominal: LoopLimits
    perturbed: LoopLimits
    resonances_from: Annotated[Frequency, Field(gt=0, description='frequency from which |L| counts as a resonance')]


def _range(kind):
    return Annotated[tuple[Annotated[kind, Field(gt=0)], Annotated[kind, Field(gt=0)]], Field()]


class Bounds(Config):
    """Search range of every parameter; candidates are uniform in its logarithm."""

    speed_crossover: _range(Frequency)
    derivative_zero: _range(Frequency)
    integral_zero: _range(Frequency)
    derivative_pole: _range(Frequency)
    lag_pole: _range(Frequency)
    lag_ratio: _range(Number)
    notch_centre: _range(Frequency)
    notch_width: _range(Frequency)
    notch_attenuation: _range(Decibel)

    @model_validator(mode='after')
    def _are_in_order(self):
        for name, (low, high) in self:
            if not low < high:
                raise ValueError(f'{name}: {low:g} to {high:g} given; expected the lower bound first')
        return self


class Search(Config):
    """Size of the genetic algorithm."""

    population: Annotated[int, Field(ge=8)]
    generations: Annotated[int, Field(ge=1)]
    restarts: Annotated[int, Field(ge=1)]


class TuningConfig(Config):
    """Configuration of `pkm tune`."""

    targets: Targets
    limits: AllLimits
    bounds: Bounds
    search: Search


def load_tuning(name_or_path='robust'):
    """Return the `TuningConfig` of config/tuning/NAME.yaml or of a path."""
    return load_config(find_config('tuning', name_or_path), TuningConfig)
