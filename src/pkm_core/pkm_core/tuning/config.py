"""Models of config/tuning: targets, limits, search range and search size of `pkm tune`, by structure."""

from typing import Annotated

from pydantic import Field, model_validator

from pkm_core.config import (
    Angle,
    Config,
    Frequency,
    Length,
    Number,
    Time,
    Voltage,
    find_config,
    load_config,
    quantity,
    read_yaml,
)
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


def _in_order(bounds):
    """Return the validated `bounds`; `ValueError` if the lower one of a pair is not the first."""
    for name, (low, high) in bounds:
        if not low < high:
            raise ValueError(f'{name}: {low:g} to {high:g} given; expected the lower bound first')
    return bounds


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

    _are_in_order = model_validator(mode='after')(_in_order)


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


class ObserverBounds(Config):
    """Search range of every weight of an observer law; candidates are uniform in its logarithm."""

    effort: _range(quantity('m/V'))
    speed: _range(Time)
    force_noise: _range(Voltage)
    drift: _range(Voltage)
    mode_noise: _range(Length)
    mode_damping: _range(Number)

    _are_in_order = model_validator(mode='after')(_in_order)


class ObserverTuning(Config):
    """Configuration of `pkm tune --structure observer`."""

    bandwidth: Annotated[Frequency, Field(gt=0, description='w of the objective D')]
    encoder_noise: Annotated[Length, Field(gt=0, description='fixed: only ratios of the noises have an effect')]
    limits: AllLimits
    bounds: ObserverBounds
    search: Search


STRUCTURES = {'pid': 'robust', 'observer': 'observer'}  # name of the default file


def load_tuning(name_or_path='robust'):
    """Return the `TuningConfig` or `ObserverTuning`, by its bounds, of config/tuning/NAME.yaml or of a path."""
    path = find_config('tuning', name_or_path)
    bounds = read_yaml(path).get('bounds')
    observer = isinstance(bounds, dict) and 'effort' in bounds
    return load_config(path, ObserverTuning if observer else TuningConfig)


def structure_of(config):
    """Return the key of `STRUCTURES` for a configuration of `load_tuning`."""
    return 'observer' if isinstance(config, ObserverTuning) else 'pid'
