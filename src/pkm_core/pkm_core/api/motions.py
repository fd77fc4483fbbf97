"""A machine and a motion: what is simulated or identified."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pkm_core import machines
from pkm_core.api.drawing import empty_figure
from pkm_core.api.typing import Array
from pkm_core.config import Configuration
from pkm_core.errors import ConfigError, TrajectoryError
from pkm_core.machines.base import Machine
from pkm_core.motion import planning
from pkm_core.motion.trajectory import SampledTrajectory, to_joints

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def load_machine(name_or_path: str | Path, *, configuration: Configuration | str | Path | None = None) -> Machine:
    """
    Return the nominal machine of config/machines/NAME.yaml or of a YAML file.

    The machine has kinematics (`forward`, `inverse`, `jacobian`), rigid dynamics (`mass_matrix`, `bias`, `gravity`,
    `inverse_dynamics`) and the facts of its drives and encoders; see `Machine`. Source: thesis, chapters 2 and 5; each
    number in the file has its origin beside it.

    Parameters
    ----------
    name_or_path : str or Path
        'four_dof', 'planar', 'xy_stage', or a path that ends in .yaml.
    configuration : Configuration or str or Path, optional
        Folder in which the models, gains, truth and motions of the machine are looked for, under its name; by default
        $PKM_CONFIG, else that of the source tree, else the installed one.

    Raises
    ------
    ConfigError
        If there is no such file, or a value is refused; file, key, value and allowed range are named.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> machine = pkm.load_machine('four_dof')
    >>> machine.joints, machine.coordinates, machine.sample_time
    (('d1', 'd3', 'd5', 'd7'), ('x', 'y', 'z', 'phi'), 0.0005)
    >>> bool(np.allclose(machine.inverse(machine.forward(machine.home)), machine.home))
    True

    """
    if isinstance(configuration, str | Path):
        if not Path(configuration).is_dir():
            raise ConfigError(f'configuration: {str(configuration)!r} given; expected a folder of configuration files')
        configuration = Configuration(Path(configuration))
    return machines.load_machine(name_or_path, configuration)


@dataclass(frozen=True, repr=False, eq=False)
class PlannedMotion:
    """
    One cycle of a motion, sampled at the servo rate: from home through the targets back to home.

    Attributes
    ----------
    name, machine : str
        Of the motion and of the machine it was planned for.
    joints : SampledTrajectory
        Joint references: `position`, `velocity`, `acceleration`, `jerk` of shape (N, n) [m, m/s, m/s^2, m/s^3];
        `move_starts`, `move_ends` of shape (moves,) [samples].
    poses : SampledTrajectory
        The same of the end-effector, (N, m) in `machine.coordinates` [m, rad].

    Examples
    --------
    >>> import pkm_core as pkm
    >>> motion = pkm.plan(pkm.load_machine('xy_stage'))
    >>> motion
    PlannedMotion('xy_stage_100ms' for xy_stage: 2 moves, 800 samples, 0.400 s)
    >>> motion.joints.position.shape, motion.time[:3].tolist()
    ((800, 2), [0.0, 0.0005, 0.001])

    """

    name: str
    machine: str
    joints: SampledTrajectory
    poses: SampledTrajectory

    def __len__(self) -> int:
        return len(self.joints)

    def __repr__(self) -> str:
        cycle = f'{len(self.joints.move_starts)} moves, {len(self)} samples, {self.duration:.3f} s'
        return f'PlannedMotion({self.name!r} for {self.machine}: {cycle})'

    @property
    def time(self) -> Array:
        """Time of the samples from the start of the cycle, shape (N,) [s]."""
        return np.arange(len(self), dtype=np.float64) * float(self.joints.sample_time)

    @property
    def duration(self) -> float:
        """Duration of the cycle [s]."""
        return float(self.joints.sample_time * len(self))

    def plot(self) -> Figure:
        """Return a figure of displacement, velocity and acceleration of every joint over the cycle."""
        figure = empty_figure(8.0, 7.0)
        panels = figure.subplots(3, 1, sharex=True)
        joints = self.joints
        rows = (1e3 * (joints.position - joints.position[0]), joints.velocity, joints.acceleration)
        labels = ('displacement [mm]', 'velocity [m/s]', 'acceleration [m/s$^2$]')
        for axes, values, label in zip(panels, rows, labels, strict=True):
            for column, joint in enumerate(joints.coordinates):
                axes.plot(1e3 * self.time, values[:, column], label=joint)
            axes.set(ylabel=label)
            axes.grid(alpha=0.3)
        panels[0].set(title=f'{self.name} of {self.machine}')
        panels[0].legend(ncols=len(joints.coordinates))
        panels[-1].set(xlabel='time [ms]')
        return figure


def plan(
    machine: Machine,
    motion: str | Path | Sequence[Sequence[float]] | Array | None = None,
    *,
    move_time: float | None = None,
) -> PlannedMotion:
    """
    Return one cycle of a motion of `machine`, in poses and in joints.

    Every move is a rest-to-rest polynomial profile; the motion returns home, so that it can be repeated and learned.
    Source: thesis (2.4) (travel); profiles: pkm_core.motion.profiles.

    Parameters
    ----------
    machine : Machine
        From `load_machine`.
    motion : str or Path or array_like, shape (k, m), optional
        Name of a file in config/motions, a path that ends in .yaml, or the poses to visit, one per row, in the order
        of `machine.coordinates` [m, rad]. By default the first file in config/motions that is for this machine.
    move_time : float, optional
        Duration of one move [s], a multiple of the sample time; by default that of the file, or 0.07 for poses.

    Raises
    ------
    ConfigError
        If there is no such file or a value in it is refused.
    TrajectoryError
        If the motion is for another machine, or a joint exceeds its limit of speed or thrust.
    WorkspaceError
        If a target cannot be reached.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> machine = pkm.load_machine('planar')
    >>> there = machine.forward(machine.home) + [2e-3, 1e-3]
    >>> pkm.plan(machine, [there], move_time=0.08)
    PlannedMotion('poses' for planar: 2 moves, 720 samples, 0.360 s)
    >>> pkm.plan(machine, 'four_dof_70ms')
    Traceback (most recent call last):
    pkm_core.errors.TrajectoryError: motion is for four_dof; the machine is planar

    """
    if motion is None:
        motion = planning.default_motion(machine)
    if isinstance(motion, (str, Path)):
        name, described = Path(motion).stem, planning.load_motion(motion, machine.configuration)
        if move_time is not None:
            if described.limits is not None:
                raise TrajectoryError(f'plan: move_time is {move_time} s; {name} has limits, which give the duration')
            described = planning.Motion(**{**dict(described), 'move_time': move_time, 'limits': None})
    else:
        name, described = 'poses', planning.poses_motion(machine, motion, move_time)
    poses = planning.plan(machine, described)
    return PlannedMotion(name, machine.name, to_joints(machine, poses), poses)
