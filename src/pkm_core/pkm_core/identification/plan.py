"""A request for an identification, and the experiments for it."""

import math
from dataclasses import dataclass, replace
from typing import Any

from pkm_core.identification import IdentificationError
from pkm_core.identification.excitation import slow_moves, sweeps
from pkm_core.identification.sweep import Sweep
from pkm_core.jet import Jet
from pkm_core.motion.trajectory import with_derivatives

KINDS = ('low_frequency', 'sweep', 'both')
POSITIONS = 3  # default number of positions of the motor pair in a sweep
_MOST_POSITIONS = 20


@dataclass(frozen=True)
class Request:
    """
    Axes and settings of an identification; invalid values raise an `IdentificationError`.

    Empty fields (no joints, '', 0), as in an empty ROS goal, take the default.
    """

    joints: tuple[str, ...] = ()  # empty: all
    kind: str = 'both'
    positions: int = 0  # of the motor pair in the sweep; 0: POSITIONS
    band: tuple[float, float] = (0.0, 0.0)  # [Hz] of the sweep; 0 0: that of `Sweep`
    voltage: float = 0.0  # [V] largest amplitude of the sweep
    jog_speed: float = 0.0  # [m/s] of the jog under the sweep
    stroke: float = 0.0  # [m] of the slow moves

    def __post_init__(self):
        if self.kind not in ('', *KINDS):
            raise IdentificationError(f'kind {self.kind!r}; known: {list(KINDS)}')
        if len(set(self.joints)) < len(self.joints):
            raise IdentificationError(f'joints {list(self.joints)}: a name is repeated; allowed once each')
        if self.positions > _MOST_POSITIONS:
            raise IdentificationError(f'positions: {self.positions}; allowed up to {_MOST_POSITIONS}')
        sizes = {
            'voltage': (self.voltage, 'V'),
            'jog_speed': (self.jog_speed, 'm/s'),
            'stroke': (self.stroke, 'm'),
            'band': (sum(self.band), 'Hz'),
        }
        for name, (value, unit) in sizes.items():
            if not (math.isfinite(value) and value >= 0):
                raise IdentificationError(f'{name}: {value} {unit} given; expected a finite number from 0')

    @property
    def moves(self):
        """Whether slow moves for K and a are included."""
        return self.kind != 'sweep'

    @property
    def shakes(self):
        """Whether sweeps for the resonances are included."""
        return self.kind != 'low_frequency'

    def sweep(self):
        """Return the requested `Sweep`."""
        given = {'voltage': self.voltage, 'speed': self.jog_speed, 'band': any(self.band) and tuple(self.band)}
        asked: dict[str, Any] = {name: value for name, value in given.items() if value}
        return replace(Sweep(), **asked)


def plan(machine, request, models, gains):
    """
    Return {joint: [Experiment]} of a `Request`; all are checked before the first motion.

    Parameters
    ----------
    machine : Machine
        Machine of the axes.
    request : Request
        Axes and settings.
    models, gains : dict of str to AxisModel, dict of str to RobustGains
        Present models and gains of all joints.

    Raises
    ------
    IdentificationError
        If a joint is unknown, or an experiment exceeds the limits of band, travel, speed or voltage.

    """
    plans = {}
    for joint in request.joints or machine.joints:
        if joint not in machine.joints:
            raise IdentificationError(f'joint {joint!r} is unknown; {machine.name} has {list(machine.joints)}')
        plans[joint] = [slow_moves(machine, joint, models[joint], stroke=request.stroke)] if request.moves else []
        if request.shakes:
            stations = request.positions or POSITIONS
            plans[joint] += sweeps(machine, joint, models[joint], gains[joint], request.sweep(), stations)
    return plans


def in_poses(machine, trajectory):
    """Return the pose trajectory of a joint `trajectory` with exact derivatives up to the jerk."""
    jet = machine.forward(Jet.from_derivatives(*trajectory.derivatives()))
    return with_derivatives(trajectory, machine.coordinates, jet)
