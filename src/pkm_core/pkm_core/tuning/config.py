"""What `pkm tune` is asked for: targets, limits, where and how far to search; files of config/tuning."""

from typing import Annotated

from pydantic import Field, model_validator

from pkm_core.config import Angle, Config, Frequency, Number, find_config, load_config
from pkm_core.control.filters import Decibel


class Targets(Config):
    """What (7.30) wants."""

    gain_margin: Annotated[Decibel, Field(gt=0)]
    phase_margin: Annotated[Angle, Field(gt=0)]
    bandwidth: Annotated[Frequency, Field(gt=0, description='of the closed loop (CLBW)')]


class LoopLimits(Config):
    """What a loop must keep."""

    gain_margin: Annotated[Decibel, Field(gt=0)]
    phase_margin: Annotated[Angle, Field(gt=0)]
    peak_sensitivity: Annotated[Number, Field(gt=1, description='largest |S|')]
    resonance_peak: Annotated[Number, Field(gt=0, description='largest |L| at the modes')]


class AllLimits(Config):
    """Limits of the model and of the perturbed models."""

    nominal: LoopLimits
    perturbed: LoopLimits
    resonances_from: Annotated[Frequency, Field(gt=0, description='frequency from which |L| counts as a resonance')]


def _range(kind):
    return Annotated[tuple[Annotated[kind, Field(gt=0)], Annotated[kind, Field(gt=0)]], Field()]


class Bounds(Config):
    """Range of every parameter; the search is even in its logarithm."""

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
                raise ValueError(f'{name}: expected the lower bound first')
        return self


class Search(Config):
    """Size of the genetic algorithm."""

    population: Annotated[int, Field(ge=8)]
    generations: Annotated[int, Field(ge=1)]
    restarts: Annotated[int, Field(ge=1)]


class TuningConfig(Config):
    """File of config/tuning."""

    targets: Targets
    limits: AllLimits
    bounds: Bounds
    search: Search


def load_tuning(name_or_path='robust'):
    """Return the `TuningConfig` of config/tuning/NAME.yaml or of a path."""
    return load_config(find_config('tuning', name_or_path), TuningConfig)
