"""Base of all machines: travel, drive and sensor data, and the compiled rigid dynamics over leading axes."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from pkm_core.config import Config, Configuration, Inertia, Length, Mass, Speed, Time, Voltage, quantity
from pkm_core.jet import as_series, value
from pkm_core.machines.checks import check_between, check_finite, check_last_axis
from pkm_core.machines.identity import Specimen
from pkm_core.machines.real_geometry import laser_axes

PositiveLength = Annotated[Length, Field(gt=0)]
NotNegativeLength = Annotated[Length, Field(ge=0)]
PositiveMass = Annotated[Mass, Field(gt=0)]
PositiveInertia = Annotated[Inertia, Field(gt=0)]

Array = NDArray[np.float64]
ROUNDING = 1e-9  # m; the inverse of a pose on a limit may round to either side of the limit


class JointConfig(Config):
    """Travel of one slider."""

    lower: Annotated[Length, Field(description='lower end of the travel')]
    upper: Annotated[Length, Field(description='upper end of the travel')]
    home: Annotated[Length, Field(description='position at power-up')]

    @model_validator(mode='after')
    def _home_lies_in_travel(self):
        if not self.lower < self.upper:
            raise ValueError(f'lower {self.lower * 1e3:g} mm is not below upper {self.upper * 1e3:g} mm')
        if not self.lower <= self.home <= self.upper:
            raise ValueError(f'home {self.home * 1e3:g} mm; allowed {self.lower * 1e3:g} to {self.upper * 1e3:g} mm')
        return self


class DriveConfig(Config):
    """One linear motor with its amplifier, the same for all axes of a machine."""

    force_constant: Annotated[quantity('N/A'), Field(gt=0, description='per ampere rms')]
    amplifier_gain: Annotated[quantity('A/V'), Field(gt=0, description='peak phase current per volt of command')]
    peak_current: Annotated[quantity('A'), Field(gt=0, description='peak of a phase')]
    voltage_limit: Annotated[Voltage, Field(gt=0, description='of the command, both signs')]
    speed_limit: Annotated[Speed, Field(gt=0)]


class MachineConfig(Config):
    """Keys common to all machine files; each mechanism adds its joints, geometry and masses."""

    mechanism: str
    sample_time: Annotated[Time, Field(gt=0, description='of encoders and controllers: one tick')]
    encoder_resolution: Annotated[PositiveLength, Field(description='one count')]
    laser_sample_time: Annotated[Time, Field(gt=0, description='of the end-point measurement')]
    drive: DriveConfig


@dataclass(frozen=True)
class Limits:
    """Limits of one machine: `lower` and `upper` per joint, speed and thrust the same for all joints."""

    lower: np.ndarray  # (n,) m
    upper: np.ndarray  # (n,) m
    speed: float  # m/s
    thrust: float  # N, at the peak current


class Compiled:
    """
    A class attribute that is the object `name` of pkm_core.machines.dynamics.

    The module, and with it numba, is imported at the first use; from then on the attribute is that object itself.
    """

    def __init__(self, name):
        self._name = name

    def __set_name__(self, owner, attribute):
        self._owner, self._attribute = owner, attribute

    def __get__(self, machine, owner):
        """Return the object, and put it into the place of this one."""
        from pkm_core.machines import dynamics

        found = getattr(dynamics, self._name)
        setattr(self._owner, self._attribute, staticmethod(found) if callable(found) else found)
        return found


class Machine(ABC):
    """
    A mechanism of n linear motors: joint positions q (..., n) [m], pose x (..., m) in `coordinates` [m, rad].

    Poses are in the base frame, whose axes X and Y are parallel to the guides; leading axes are samples.

    Attributes
    ----------
    Config : class
        Model of the machine's file.
    joints, coordinates : tuple of str
        Names of the entries of q and of a pose.
    parameters : tuple of str
        Names of the entries of the vector p that `terms` takes.
    terms, rows : compiled functions
        The kernel ``terms(q, qd, p, M, C, G)`` of pkm_core.machines.dynamics, and the same over the rows of histories.
    home : ndarray, shape (n,)
        Joint positions at power-up [m].
    configuration : Configuration
        Source of the models, gains, truth and motions of the machine.
    sample_time, encoder_resolution, laser_sample_time, voltage_limit, thrust_per_volt : float
        [s], [m/count], [s], [V], [N/V].

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> machine = load_machine('planar')
    >>> machine
    Planar('planar', joints d1, d3, 0.5 ms)
    >>> machine.mass_matrix(machine.home).shape
    (2, 2)

    """

    Config: type[MachineConfig]
    joints: tuple[str, ...]
    coordinates: tuple[str, ...]
    parameters: tuple[str, ...]
    terms: Callable
    rows: Callable

    def __init__(self, config, name, configuration=None):
        self.config = config
        self.name = name
        self.configuration = configuration or Configuration.of_environment()
        travel = [getattr(config.joints, joint) for joint in self.joints]
        drive = config.drive
        thrust_per_ampere = drive.force_constant / math.sqrt(2.0)  # of peak current; the constant is per ampere rms
        self.home = _constant([joint.home for joint in travel])
        self.limits = Limits(
            lower=_constant([joint.lower for joint in travel]),
            upper=_constant([joint.upper for joint in travel]),
            speed=drive.speed_limit,
            thrust=thrust_per_ampere * drive.peak_current,
        )
        self.sample_time = config.sample_time
        self.encoder_resolution = config.encoder_resolution
        self.laser_sample_time = config.laser_sample_time
        self.voltage_limit = drive.voltage_limit
        self.thrust_per_volt = thrust_per_ampere * drive.amplifier_gain

    def __repr__(self) -> str:
        return f'{type(self).__name__}({self.name!r}, joints {", ".join(self.joints)}, {1e3 * self.sample_time:g} ms)'

    @property
    def drawing(self) -> 'Machine':
        """This machine with its drawn lengths, without the section `built`."""
        if getattr(self.config, 'built', None) is None:
            return self
        return type(self)(self.config.model_copy(update={'built': None}), self.name, self.configuration)

    @property
    def drive_limit(self) -> float:
        """Voltage [V] at which a drive reaches its limit of voltage or thrust."""
        return min(self.voltage_limit, self.limits.thrust / self.thrust_per_volt)

    @property
    def specimen(self) -> Specimen | None:
        """The built machine that the lengths of the section `built` are of; None for the drawing."""
        built = getattr(self.config, 'built', None)
        return None if built is None else built.specimen

    def check_specimen(self, seed: int, environment: str) -> None:
        """
        Refuse a simulated machine of another specimen than this calibrated one; the drawing suits every specimen.

        Raises
        ------
        ConfigError
            If the calibrated lengths are of another machine, seed or environment, or of a real machine; both are named.

        """
        if self.specimen is not None:
            self.specimen.check(Specimen.simulated(self.name, seed, environment))

    @property
    def laser_axes(self) -> Array:
        """Matrix (m, m) from a displacement of the pose to the laser's reading of it; identity without calibration."""
        return laser_axes(self.coordinates, dict(self._geometry or {}))

    def read_by_laser(self, q: ArrayLike) -> Array:
        """Return `forward` at `q` (..., n) along the calibrated axes of the laser, (..., m); `forward` without them."""
        pose = self.forward(q)
        return pose if self._geometry is None else pose @ self.laser_axes.T

    def from_laser(self, displacement: Array) -> Array:
        """Return the displacement (..., m) in the base frame of one read by the laser, by its calibrated axes."""
        return displacement if self._geometry is None else displacement @ np.linalg.inv(self.laser_axes).T

    @property
    def _geometry(self):
        return getattr(getattr(self.config, 'built', None), 'geometry', None)

    def with_configuration(self, configuration: Configuration) -> 'Machine':
        """Return the same machine with models, gains, truth and motions of another `Configuration`."""
        return type(self)(self.config, self.name, configuration)

    @abstractmethod
    def forward(self, q: Any) -> Any:
        """Return the pose (..., m) at joint positions `q` (..., n), array or Jet; `WorkspaceError` out of reach."""

    @abstractmethod
    def inverse(self, x: Any) -> Any:
        """Return the joint positions (..., n) at the pose `x` (..., m), array or Jet; `WorkspaceError` out of reach."""

    @abstractmethod
    def jacobian(self, q: ArrayLike) -> Array:
        """Return d forward / dq (..., m, n) at `q` (..., n) [m/m, rad/m]."""

    @abstractmethod
    def singularity_margin(self, q: ArrayLike) -> Array:
        """Return the distance (...,) [m] from the nearest singularity, as defined by the mechanism."""

    @abstractmethod
    def passive_angles(self, q: Any) -> dict[str, Any]:
        """Return {name: angle (...,) [rad]} of the joints without a motor, for an array or Jet `q` (..., n)."""

    @abstractmethod
    def dynamic_parameters(self) -> Array:
        """Return the nominal vector p of `terms`, a new array in the order of `parameters` [SI]."""

    def check_joints(self, q: ArrayLike) -> None:
        """Refuse joint positions `q` (..., n) that are not finite or outside the travel (2.4): `WorkspaceError`."""
        q = self._joints(q)
        check_finite(q, self.joints)
        check_between(q, self.limits.lower, self.limits.upper, self.joints, 'travel', slack=ROUNDING)

    def check_pose(self, x: ArrayLike) -> None:
        """Refuse poses `x` (..., m) that the mechanism or the travel of its sliders cannot reach: `WorkspaceError`."""
        self.check_joints(self.inverse(x))

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return M (..., n, n) [kg] at `q` (..., n), symmetric and positive definite."""
        return self._terms(q, np.zeros(len(self.joints)))[0]

    def bias(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Return C (..., n) [N], the Coriolis and centrifugal forces at `q`, `qd` (..., n)."""
        return self._terms(q, qd)[1]

    def gravity(self, q: ArrayLike) -> Array:
        """Return G (..., n) [N], the slider forces that hold the mechanism at rest at `q` (..., n)."""
        return self._terms(q, np.zeros(len(self.joints)))[2]

    def inverse_dynamics(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Return the slider forces F = M qdd + C + G (..., n) [N] of the motion `q`, `qd`, `qdd` (..., n); (5.1)."""
        M, C, G = self._terms(q, qd)
        return np.einsum('...ij,...j->...i', M, self._joints(qdd)) + C + G

    def _terms(self, q, qd):
        q = self._joints(q)
        self.forward(q)  # raises with the joints that are out of reach; the kernels would return NaN
        q, qd = np.broadcast_arrays(q, self._joints(qd))
        n = q.shape[-1]
        M, C, G = np.empty((q.size // n, n, n)), np.empty((q.size // n, n)), np.empty((q.size // n, n))
        rows = (np.ascontiguousarray(part).reshape(-1, n) for part in (q, qd))
        self.rows(*rows, self.dynamic_parameters(), M, C, G)
        return M.reshape(*q.shape, n), C.reshape(q.shape), G.reshape(q.shape)

    def _joints(self, q):
        q = as_series(q)
        check_last_axis(q, self.joints, f'joint vector of {self.name}')
        return q

    def _pose(self, x):
        x = as_series(x)
        check_last_axis(x, self.coordinates, f'pose of {self.name}')
        check_finite(value(x), self.coordinates)
        return x


def _constant(values):
    array = np.array(values)
    array.flags.writeable = False
    return array
