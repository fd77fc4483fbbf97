"""
The truth of a simulated machine: strict models of config/truth/NAME.yaml and their loader.

Only the plant and the files it is made of may import this module; controllers, learning and identification hold their
own model (config/model). A file has two layers: what the machine is (axes, drive, friction, ...) and, by name, the
environments it can stand in, which say how strongly each imperfection acts: `ideal`, `nominal`, `hard`, `exact`, which
is `nominal` with links and marks as drawn, and for the 4-DOF manipulator `elastic`, which is `nominal` with belts that
give and modes that depend on position.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pkm_core.config import (
    Config,
    Force,
    Frequency,
    Length,
    Mass,
    Number,
    Speed,
    Time,
    Voltage,
    load_config,
    quantity,
)
from pkm_core.errors import ConfigError

Share = Annotated[Number, Field(ge=0.0, lt=1.0)]  # a relative level, e.g. '3 %'


class Mode(Config):
    """One factor of H_i (7.20); a negative damping of the antiresonance is a pair of right-half-plane zeros."""

    resonance: Annotated[Frequency, Field(gt=0.0)]
    resonance_damping: Annotated[Number, Field(gt=0.0, lt=1.0)]
    antiresonance: Annotated[Frequency, Field(gt=0.0)]
    antiresonance_damping: Annotated[Number, Field(gt=-1.0, lt=1.0)]


class Axis(Config):
    """One driven joint: identified model L_i H_i (7.18)-(7.20) and by how much this specimen differs from it."""

    gain: Annotated[quantity('m/s^2/V'), Field(gt=0.0)] | None = None  # K_i; absent: thrust over the mass at home
    viscosity: Annotated[quantity('1/s'), Field(ge=0.0)]  # a_i
    gain_error: Annotated[Number, Field(gt=-0.5, lt=0.5)]  # of the thrust
    viscosity_error: Annotated[Number, Field(gt=-1.0, lt=1.0)]
    direction: Literal['x', 'y']  # along which its guide lies
    modes: tuple[Mode, ...]

    @model_validator(mode='after')
    def _resonances_differ(self):
        frequencies = [mode.resonance for mode in self.modes]
        if len(set(frequencies)) < len(frequencies):
            raise ValueError(f'modes: resonances {frequencies} Hz; all of a joint must differ')
        return self


class Drive(Config):
    """What the nominal design does not say of amplifier and motor; winding values are phase to phase (Table 6.2)."""

    dac_bits: Annotated[int, Field(ge=8, le=24)]
    bandwidth: Annotated[Frequency, Field(gt=0.0)]  # -3 dB of the current loop, (6.3)
    delay: Annotated[Time, Field(ge=0.0)]
    resistance: Annotated[quantity('ohm'), Field(gt=0.0)]
    inductance: Annotated[quantity('H'), Field(gt=0.0)]
    pitch: Annotated[Length, Field(gt=0.0)]  # of the magnets: one electrical turn
    continuous_current: Annotated[quantity('A'), Field(gt=0.0)]  # rms of a phase
    thermal_time: Annotated[Time, Field(gt=0.0)]  # of the i2t limit, which falls back to continuous_current


class Friction(Config):
    """Presliding and Stribeck curve of one guide (friction.py); the Coulomb force is set by the environment."""

    stiffness: Annotated[quantity('N/m'), Field(gt=0.0)]  # presliding
    damping: Annotated[quantity('N s/m'), Field(ge=0.0)]  # presliding
    elastic: Annotated[Number, Field(gt=0.0, lt=1.0)]  # share of the bend at breakaway below which nothing creeps
    breakaway: Annotated[Number, Field(ge=1.0)]  # static over Coulomb force
    stribeck_speed: Annotated[Speed, Field(gt=0.0)]


class Stops(Config):
    """Mechanical stoppers outside the travel, and carriages on one guide that may meet, (2.4)."""

    clearance: Annotated[Length, Field(gt=0.0)]  # from the end of the travel
    stiffness: Annotated[quantity('N/m'), Field(gt=0.0)]
    damping: Annotated[quantity('s/m'), Field(ge=0.0)]  # Hunt-Crossley: force k d (1 + c d')
    carriages: tuple[tuple[str, str], ...]  # (lower, higher) joints of one guide
    carriage_length: Annotated[Length, Field(ge=0.0)]


class Belts(Config):
    """Belts that keep the platforms P and Q from turning; thesis section 5.5."""

    stiffness: Annotated[quantity('N m/rad'), Field(gt=0.0)]
    damping: Annotated[quantity('N m s/rad'), Field(ge=0.0)]


class Payload(Config):
    """A mass that rides on named masses of the dynamic model."""

    mass: Annotated[Mass, Field(ge=0.0)]
    carried_by: tuple[str, ...]  # names of dynamic parameters


class Platform(Config):
    """The platform on its linkage, beyond the reach of the encoders (platform.py)."""

    resonance: Annotated[Frequency, Field(gt=0.0)]
    damping: Annotated[Number, Field(gt=0.0, lt=1.0)]


class LaserTruth(Config):
    """What one reading of the end-point measurement is worth; its clock is in the machine's file."""

    resolution: Annotated[Length, Field(gt=0.0)]
    rotation_arm: Annotated[Length, Field(gt=0.0)]  # over which a rotation is seen as a displacement


class Environment(Config):
    """How strongly each imperfection acts; spreads are standard deviations unless said."""

    model_error: bool  # gain_error and viscosity_error of the axes
    modes: bool  # of the axes and of the platform
    mode_shift: Annotated[Number, Field(gt=-0.3, lt=0.3)]  # of all frequencies, from home to the farther end of travel
    belts: bool
    back_emf: bool
    coulomb_friction: Annotated[Force, Field(ge=0.0)]
    friction_jitter: Share  # half width of the uniform spread from cycle to cycle
    gain_jitter: Share  # of the thrust, from cycle to cycle
    ripple: Share  # of the thrust, once a pitch
    cogging: Annotated[Force, Field(ge=0.0)]  # amplitude, twice a pitch
    amplifier_noise: Annotated[Voltage, Field(ge=0.0)]  # referred to the command
    floor_vibration: Annotated[quantity('m/s^2'), Field(ge=0.0)]  # rms in x and in y
    encoder_noise: Annotated[Number, Field(ge=0.0)]  # half width, counts
    subdivision_error: Annotated[Length, Field(ge=0.0)]  # amplitude, once a signal period
    encoder_latency: Annotated[Time, Field(ge=0.0)]
    encoder_offset: Annotated[Length, Field(ge=0.0)]  # of the reference marks
    link_error: Annotated[Length, Field(ge=0.0)]
    payload_spread: Share  # of the payload
    laser_noise: Annotated[Length, Field(ge=0.0)]


class Truth(Config):
    """Everything config/truth/NAME.yaml says of one machine."""

    substep: Annotated[Time, Field(gt=0.0)]  # of the integration; must divide the sample time
    axes: dict[str, Axis]
    drive: Drive
    friction: Friction
    stops: Stops
    signal_period: Annotated[Length, Field(gt=0.0)]  # of the encoder's scale
    vibration_band: tuple[Frequency, Frequency]
    payload: Payload
    platform: Platform
    laser: LaserTruth
    belts: Belts | None = None
    environments: dict[str, Environment]

    @model_validator(mode='after')
    def _agrees(self):
        if self.drive.delay >= self.substep:
            raise ValueError(f'drive.delay {self.drive.delay:g} s is not below substep {self.substep:g} s')
        for pair in self.stops.carriages:
            for joint in pair:
                if joint not in self.axes:
                    raise ValueError(f'stops.carriages: unknown joint {joint!r}; axes has {sorted(self.axes)}')
        for name, environment in self.environments.items():
            if environment.belts and self.belts is None:
                raise ValueError(f'environments.{name}: belts is true but the machine has no section belts')
        lower, upper = self.vibration_band
        if not 0.0 <= lower < upper:
            raise ValueError(f'vibration_band: {lower:g} to {upper:g} Hz given; allowed 0 <= lower < upper')
        return self


def load_truth(machine, environment):
    """
    Return (Truth, Environment) of `machine` from config/truth/<machine.name>.yaml.

    Raises
    ------
    ConfigError
        If the file is refused, names other joints than the machine, or does not know the environment.

    """
    path = machine.configuration.find('truth', machine.name)
    truth = load_config(path, Truth)
    if tuple(truth.axes) != tuple(machine.joints):
        raise ConfigError(f'{path}: axes {list(truth.axes)} given; the machine has the joints {list(machine.joints)}')
    steps = machine.sample_time / truth.substep
    if abs(steps - round(steps)) > 1e-9 * steps or round(steps) < 1:
        raise ConfigError(f'{path}: substep {truth.substep:g} s does not divide the tick of {machine.sample_time:g} s')
    if environment not in truth.environments:
        raise ConfigError(f'{path}: environment {environment!r} is unknown; known: {sorted(truth.environments)}')
    return truth, truth.environments[environment]
