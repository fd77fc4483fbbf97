"""
The truth of a simulated machine: strict models of config/truth/NAME.yaml and their loader.

Only the plant may import this module. Controllers, learning and identification have their own model (config/model).

A file has two layers: the machine itself (axes, drive, friction, ...) and named environments. An environment sets the
level of each imperfection:

- `ideal`: none
- `nominal`, `hard`: two levels of all of them
- `exact`: `nominal` with links and marks as drawn
- `elastic` (4-DOF manipulator only): `nominal` with elastic belts, modes that depend on position, and a platform whose
  mode differs between coordinates
- `geometric`: `nominal` with errors of guides, scales and laser axes
- `warm` (machines with links only): `nominal` with temperatures of motors, links and scales
- `flexible` (4-DOF and planar manipulator): `nominal` with modes that react on the machine and are shared by axes
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pkm_core.config import (
    Angle,
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
from pkm_core.plant.heat_levels import HeatLevels

Share = Annotated[Number, Field(ge=0.0, lt=1.0)]  # a relative level, e.g. '3 %'


class Mode(Config):
    """One factor of H_i (7.20): a pair of zeros over a pair of poles."""

    resonance: Annotated[Frequency, Field(gt=0.0, description='poles of the factor')]
    resonance_damping: Annotated[Number, Field(gt=0.0, lt=1.0)]
    antiresonance: Annotated[Frequency, Field(gt=0.0, description='zeros of the factor')]
    antiresonance_damping: Annotated[
        Number, Field(gt=-1.0, lt=1.0, description='negative: zeros in the right half plane')
    ]


class Axis(Config):
    """One driven joint: identified model L_i H_i (7.18)-(7.20) and the deviation of the simulated axis from it."""

    gain: (
        Annotated[quantity('m/s^2/V'), Field(gt=0.0, description='K_i; absent: thrust over the mass at home')] | None
    ) = None
    viscosity: Annotated[quantity('1/s'), Field(ge=0.0, description='a_i')]
    gain_error: Annotated[Number, Field(gt=-0.5, lt=0.5, description='relative error of the thrust')]
    viscosity_error: Annotated[Number, Field(gt=-1.0, lt=1.0, description='relative error of a_i')]
    direction: Annotated[Literal['x', 'y'], Field(description='base axis along which the guide lies')]
    modes: tuple[Mode, ...]

    @model_validator(mode='after')
    def _resonances_differ(self):
        frequencies = [mode.resonance for mode in self.modes]
        if len(set(frequencies)) < len(frequencies):
            raise ValueError(f'modes: resonances {frequencies} Hz; the resonances of a joint must differ')
        return self


class Drive(Config):
    """Amplifier and motor, beyond the values of the nominal design (Table 6.2)."""

    dac_bits: Annotated[int, Field(ge=8, le=24, description='of the command converter')]
    bandwidth: Annotated[Frequency, Field(gt=0.0, description='-3 dB of the current loop, (6.3)')]
    delay: Annotated[Time, Field(ge=0.0, description='of the current command; below a substep')]
    resistance: Annotated[quantity('ohm'), Field(gt=0.0, description='phase to phase')]
    inductance: Annotated[quantity('H'), Field(gt=0.0, description='phase to phase')]
    pitch: Annotated[Length, Field(gt=0.0, description='of the magnets: one electrical turn')]
    continuous_current: Annotated[quantity('A'), Field(gt=0.0, description='rms of a phase')]
    thermal_time: Annotated[Time, Field(gt=0.0, description='of the i2t limit, which falls back to continuous_current')]


class Friction(Config):
    """Presliding and Stribeck curve of one guide (friction.py); the Coulomb force is set by the environment."""

    stiffness: Annotated[quantity('N/m'), Field(gt=0.0, description='presliding')]
    damping: Annotated[quantity('N s/m'), Field(ge=0.0, description='presliding')]
    elastic: Annotated[Number, Field(gt=0.0, lt=1.0, description='share of the breakaway deflection without creep')]
    breakaway: Annotated[Number, Field(ge=1.0, description='static over Coulomb force')]
    stribeck_speed: Annotated[Speed, Field(gt=0.0)]


class Stops(Config):
    """Mechanical stoppers outside the travel, and carriages on one guide that may collide, (2.4)."""

    clearance: Annotated[Length, Field(gt=0.0, description='from the end of the travel')]
    stiffness: Annotated[quantity('N/m'), Field(gt=0.0)]
    damping: Annotated[quantity('s/m'), Field(ge=0.0, description="Hunt-Crossley: force k d (1 + c d')")]
    carriages: Annotated[tuple[tuple[str, str], ...], Field(description='(lower, higher) joints of one guide')]
    carriage_length: Annotated[Length, Field(ge=0.0, description='least distance of two carriages on a guide')]


class Belts(Config):
    """Belts that prevent rotation of the platforms P and Q; thesis section 5.5."""

    stiffness: Annotated[quantity('N m/rad'), Field(gt=0.0)]
    damping: Annotated[quantity('N m s/rad'), Field(ge=0.0)]


class Payload(Config):
    """A mass added to named masses of the dynamic model."""

    mass: Annotated[Mass, Field(ge=0.0)]
    carried_by: Annotated[tuple[str, ...], Field(description='names of dynamic parameters')]


class Platform(Config):
    """Elasticity between linkage and platform, which the encoders do not measure (platform.py)."""

    resonance: Annotated[Frequency, Field(gt=0.0)]
    damping: Annotated[Number, Field(gt=0.0, lt=1.0)]


class LaserTruth(Config):
    """Resolution of the end-point measurement; its clock is in the machine's file."""

    resolution: Annotated[Length, Field(gt=0.0)]
    rotation_arm: Annotated[Length, Field(gt=0.0, description='displacement per rotation [m/rad]')]


class GeometryLevels(Config):
    """Errors of guides, scales and laser axes, standard deviations over the specimens; see geometry.py."""

    scale: Annotated[Number, Field(ge=0.0, le=1e-3, description='of each encoder, relative')]
    square: Annotated[Angle, Field(ge=0.0, le=1e-2, description='turn of the Y guide about Z')]
    tilt: Annotated[Angle, Field(ge=0.0, le=1e-2, description='turn of the Y guide about X and about its direction')]
    height: Annotated[Length, Field(ge=0.0, le=1e-3, description='of the Y guide over the X guide')]
    straightness: Annotated[Length, Field(ge=0.0, le=1e-4, description='longest wave of a guide, in each direction')]
    laser_axes: Annotated[Angle, Field(ge=0.0, le=1e-2, description='of each direction of measurement')]


class FlexibleLevels(Config):
    """Modes of the axes as masses on the links, which react on the sliders; see flexible.py."""

    mass: Annotated[Number, Field(gt=0.0, le=0.1, description='of each mode, relative to the mass of its axis at home')]
    shared: Annotated[Number, Field(ge=0.0, le=1.0, description='by both sliders of a link pair: 0 none, 1 all')]
    directions: Annotated[
        tuple[Literal['across', 'along'], ...],
        Field(description='of the modes of every axis in their order, relative to the guide of the pair'),
    ]


class Environment(Config):
    """Level of each imperfection; spreads are standard deviations unless stated otherwise."""

    model_error: Annotated[bool, Field(description='gain_error and viscosity_error of the axes act')]
    modes: Annotated[bool, Field(description='of the axes and of the platform')]
    mode_shift: Annotated[
        Number, Field(gt=-0.3, lt=0.3, description='of all frequencies, from home to the farther end')
    ]
    belts: Annotated[bool, Field(description='the belts are elastic')]
    back_emf: Annotated[bool, Field(description='the back EMF of the motors acts')]
    coulomb_friction: Annotated[Force, Field(ge=0.0, description='force of each guide')]
    friction_jitter: Annotated[Share, Field(description='half width of the uniform spread from cycle to cycle')]
    gain_jitter: Annotated[Share, Field(description='of the thrust, from cycle to cycle')]
    ripple: Annotated[Share, Field(description='of the thrust, once per pitch')]
    cogging: Annotated[Force, Field(ge=0.0, description='amplitude, twice per pitch')]
    amplifier_noise: Annotated[Voltage, Field(ge=0.0, description='referred to the command')]
    floor_vibration: Annotated[quantity('m/s^2'), Field(ge=0.0, description='rms in x and in y')]
    encoder_noise: Annotated[Number, Field(ge=0.0, description='half width, counts')]
    subdivision_error: Annotated[Length, Field(ge=0.0, description='amplitude, once per signal period')]
    encoder_latency: Annotated[Time, Field(ge=0.0, description='from sampling to the reading')]
    encoder_offset: Annotated[Length, Field(ge=0.0, description='of the reference marks')]
    link_error: Annotated[Length, Field(ge=0.0, description='of every link length')]
    payload_spread: Annotated[Share, Field(description='of the payload')]
    laser_noise: Annotated[Length, Field(ge=0.0, description='of one reading')]
    geometry: GeometryLevels | None = None
    heat: HeatLevels | None = None
    platform: Annotated[
        dict[str, Platform] | None,
        Field(description="by coordinate of the end point, all of them; absent: the machine's in every one"),
    ] = None
    flexible: FlexibleLevels | None = None


class Truth(Config):
    """Truth of one simulated machine."""

    substep: Annotated[Time, Field(gt=0.0, description='of the integration; must divide the sample time')]
    axes: dict[str, Axis]
    drive: Drive
    friction: Friction
    stops: Stops
    signal_period: Annotated[Length, Field(gt=0.0, description="of the encoder's scale")]
    vibration_band: Annotated[
        tuple[Frequency, Frequency], Field(description='lower and upper end of the floor vibration')
    ]
    payload: Payload
    platform: Platform
    laser: LaserTruth
    belts: Belts | None = None
    environments: dict[str, Environment]

    @model_validator(mode='after')
    def _agrees(self):
        if self.drive.delay >= self.substep:
            raise ValueError(f'drive.delay {self.drive.delay:g} s given; allowed below substep {self.substep:g} s')
        for pair in self.stops.carriages:
            for joint in pair:
                if joint not in self.axes:
                    raise ValueError(f'stops.carriages: unknown joint {joint!r}; axes has {sorted(self.axes)}')
        for name, environment in self.environments.items():
            if environment.belts and self.belts is None:
                raise ValueError(f'environments.{name}: belts is true but the machine has no section belts')
            if environment.flexible:
                self._check_flexible(name, environment)
        lower, upper = self.vibration_band
        if not 0.0 <= lower < upper:
            raise ValueError(f'vibration_band: {lower:g} to {upper:g} Hz given; allowed 0 <= lower < upper')
        return self

    def _check_flexible(self, name, level):
        flexible = level.flexible
        if not level.modes or level.belts or level.mode_shift:
            raise ValueError(
                f'environments.{name}: flexible given with modes {level.modes}, belts {level.belts}, mode_shift '
                f'{100 * level.mode_shift:g} %; allowed with modes true, belts false, mode_shift 0 %'
            )
        paired = {joint for pair in self.stops.carriages for joint in pair}
        for joint, axis in self.axes.items():
            if joint not in paired or axis.gain is None:
                raise ValueError(
                    f'environments.{name}: flexible given; {joint} has no pair in stops.carriages or no gain'
                )
            if len(axis.modes) != len(flexible.directions):
                raise ValueError(
                    f'environments.{name}.flexible.directions: {len(flexible.directions)} given; {joint} has '
                    f'{len(axis.modes)} modes'
                )


def load_truth(machine, environment):
    """
    Return (Truth, Environment) of `machine` from config/truth/<machine.name>.yaml.

    Raises
    ------
    ConfigError
        If the file is refused, its joints are not those of the machine, or it has no such environment.

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
    levels = truth.environments[environment]
    if levels.platform is not None and set(levels.platform) != set(machine.coordinates):
        raise ConfigError(
            f'{path}: environments.{environment}.platform: {list(levels.platform)} given; allowed: one mode for each '
            f'of {list(machine.coordinates)}'
        )
    return truth, levels


def platform_modes(machine, truth, levels):
    """Return the `Platform` of each coordinate of `machine` in the environment `levels`, in their order."""
    own = levels.platform or {}
    return [own.get(coordinate, truth.platform) for coordinate in machine.coordinates]
