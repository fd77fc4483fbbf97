"""
Model of an axis as used by its controller: config/model/<machine>.yaml, written by identification.

P(s) = K/(s (s + a)) * H(s), H = PROD (wr^2/wa^2)(s^2 + 2 za wa s + wa^2)/(s^2 + 2 zr wr s + wr^2) (7.18)-(7.20).
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from pkm_core.config import Config, Frequency, Length, Number, Voltage, load_config, quantity
from pkm_core.errors import ConfigError


class Mode(Config):
    """A resonance and its anti-resonance."""

    resonance: Annotated[Frequency, Field(gt=0)]
    resonance_damping: Annotated[Number, Field(gt=0, lt=1)]
    antiresonance: Annotated[Frequency, Field(gt=0)]
    antiresonance_damping: Annotated[Number, Field(gt=-1, lt=1, description='negative: zeros in the right half plane')]

    def low_frequency_delay(self):
        """Return the delay [s] of slow signals: 2 zr/wr - 2 za/wa."""
        resonance = self.resonance_damping / self.resonance
        return (resonance - self.antiresonance_damping / self.antiresonance) / np.pi


class Forces(Config):
    """
    Forces on a slider that K/(s (s + a)) does not include, as the drive voltage that balances them.

    Friction is ``coulomb`` z, z from -1 to 1 by the model of Dahl over the distance ``slip``. With A = 2 pi x/``pitch``
    the thrust is u (1 + ``ripple_sine`` sin A + ``ripple_cosine`` cos A) + ``cogging_sine`` sin 2A + ``cogging_cosine``
    cos 2A. The coupling is that of the nominal design's M, C and G.
    """

    coulomb: Annotated[Voltage, Field(ge=0, description='friction of a sliding guide')]
    slip: Annotated[Length, Field(gt=0, description='travel over which friction reverses, to 1/e')]
    coupling: Annotated[Number, Field(ge=0, le=2, description="share of the design's coupling forces; 0: none")]
    pitch: Annotated[Length, Field(gt=0, description='of the magnets: one electrical turn')] = 30e-3
    ripple_sine: Annotated[Number, Field(gt=-0.3, lt=0.3, description='of the thrust, once per pitch')] = 0.0
    ripple_cosine: Annotated[Number, Field(gt=-0.3, lt=0.3, description='of the thrust, once per pitch')] = 0.0
    cogging_sine: Annotated[Voltage, Field(gt=-1, lt=1, description='thrust without current, twice per pitch')] = 0.0
    cogging_cosine: Annotated[Voltage, Field(gt=-1, lt=1, description='thrust without current, twice per pitch')] = 0.0


class AxisModel(Config):
    """Drive voltage [V] to slider position [m] of one axis."""

    gain: Annotated[quantity('m/s^2/V'), Field(gt=0, description='K')]
    viscosity: Annotated[quantity('1/s'), Field(ge=0, description='a')]
    current_loop: Annotated[Frequency, Field(gt=0, description='corner of the first-order current loop (6.3)')]
    modes: tuple[Mode, ...]
    forces: Annotated[Forces | None, Field(description='for the feedforward; absent: (7.24) alone')] = None

    def low_frequency_delay(self):
        """Return the delay [s] of slow signals from voltage to position, without sampling."""
        return 1 / (2 * np.pi * self.current_loop) + sum(mode.low_frequency_delay() for mode in self.modes)


class ModelFile(Config):
    """Models of the axes as used by the controllers."""

    joints: dict[str, AxisModel]


def load_model(machine, name_or_path=None):
    """Return {joint: AxisModel} of config/model, by default of the file with the machine's name."""
    path = machine.configuration.find('model', name_or_path or machine.name)
    return in_joint_order(machine, load_config(path, ModelFile).joints, path)


def in_joint_order(machine, per_joint, path):
    """Return `per_joint` in the order of the machine's joints; `ConfigError` unless it has exactly these joints."""
    if set(per_joint) != set(machine.joints):
        raise ConfigError(f'{path}: joints are {sorted(per_joint)}; {machine.name} has {list(machine.joints)}')
    return {joint: per_joint[joint] for joint in machine.joints}
