"""The closed loop, cycle after cycle: plant, controllers and learning law, with the bits of the cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pkm_core.api.cycles import Cycle
from pkm_core.api.drawing import empty_figure
from pkm_core.api.motions import PlannedMotion, plan
from pkm_core.api.own import Controller, LearningLaw, own_controller, own_law
from pkm_core.api.typing import Array, checked_array, checked_count
from pkm_core.control.controllers import choose_control
from pkm_core.control.pid import AxisLaw
from pkm_core.errors import LearningError, PkmError, TrajectoryError
from pkm_core.learning import make_law
from pkm_core.machines.base import Machine
from pkm_core.simulation.cycles import CycleRecords, run_cycles

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False, eq=False)
class Simulation:
    """
    Simulated cycles of one motion from power-up; `cycle(number)` returns one of them with all its signals.

    Attributes
    ----------
    motion : PlannedMotion
        What was driven.
    controller, law : str
        Their names; of an own one, that of its class.
    seed, environment : int, str
        Of the simulated machine.
    records : CycleRecords
        `error`, `voltage`, `feedforward` and `counts` of shape (cycles, N, n) [m, V, V, counts].
    encoder_resolution : float
        [m/count]
    coordinates : tuple of str
        Names of the pose.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> result = pkm.simulate(pkm.load_machine('xy_stage'), cycles=3, law='inverse')
    >>> result
    Simulation(3 cycles of xy_stage_100ms, controller robust, law inverse, seed 1, nominal: 19.8 um to 0.9 um)
    >>> result.max_dynamic_error.shape, result.error.shape
    ((3, 2), (3, 800, 2))

    """

    motion: PlannedMotion
    controller: str
    law: str
    seed: int
    environment: str
    records: CycleRecords
    encoder_resolution: float
    coordinates: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.records.error)

    def __repr__(self) -> str:
        worst = 1e6 * self.max_dynamic_error.max(axis=1)
        return (
            f'Simulation({len(self)} cycles of {self.motion.name}, controller {self.controller}, law {self.law}, '
            f'seed {self.seed}, {self.environment}: {worst[0]:.1f} um to {worst[-1]:.1f} um)'
        )

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.records.joints

    @property
    def error(self) -> Array:
        """Reference minus position, shape (cycles, N, n) [m]."""
        return self.records.error

    @property
    def max_dynamic_error(self) -> Array:
        """Largest error in motion, shape (cycles, n) [m]."""
        return self.metric('max_dynamic_error')

    @property
    def notices(self) -> tuple[str, ...]:
        """What the monitors of the learning noticed, in order."""
        return self.records.notices

    def metric(self, name: str) -> Array:
        """
        Return a metric of every cycle and joint, shape (cycles, n).

        `name` is 'max_dynamic_error' [m], 'settling_time_5um', 'settling_time_1um' [s] (nan: never settled) or
        'steady_state_error' [m]; see `Cycle.metrics`.
        """
        return np.asarray(self.records.metric(name), dtype=np.float64)

    def cycle(self, number: int) -> Cycle:
        """Return cycle `number`, from 1 to ``len(result)``; `PkmError` otherwise."""
        number = checked_count('cycle', number, 1)
        if number > len(self):
            raise PkmError(f'cycle: {number} given; allowed 1 to {len(self)}')
        ran, joints = self.records, self.motion.joints
        seen = ran.laser[number - 1] if ran.laser else None
        start = joints.sample_time * len(joints) * (number - 1)
        return Cycle(
            motion=self.motion.name,
            law=self.law,
            number=number,
            joints=ran.joints,
            coordinates=self.coordinates,
            sample_time=joints.sample_time,
            samples=len(joints),
            position=ran.counts[number - 1] * self.encoder_resolution,
            reference=joints.position,
            error=ran.error[number - 1],
            counts=ran.counts[number - 1],
            voltage=ran.voltage[number - 1],
            feedforward=ran.feedforward[number - 1],
            move_starts=joints.move_starts,
            move_ends=joints.move_ends,
            laser_time=np.zeros(0) if seen is None else seen.time - start,
            laser=np.zeros((0, len(self.coordinates))) if seen is None else seen.displacement,
        )

    def plot(self) -> Figure:
        """Return a figure: the largest error of each cycle, and the error of the first and the last over time."""
        figure = empty_figure(10.0, 6.0)
        left, right = figure.subplots(1, 2)
        numbers, time = np.arange(1, len(self) + 1), 1e3 * self.motion.time
        for column, joint in enumerate(self.joints):
            left.semilogy(numbers, 1e6 * self.max_dynamic_error[:, column], marker='.', label=joint)
            right.plot(time, 1e6 * self.error[0, :, column], color='0.8', linewidth=0.8)
        for column in range(len(self.joints)):
            right.plot(time, 1e6 * self.error[-1, :, column], color=f'C{column}', linewidth=0.8)
        left.set(xlabel='cycle', ylabel='largest error in motion [um]', title=f'{self.controller}, law {self.law}')
        left.legend()
        right.set(xlabel='time [ms]', ylabel='error [um]', title=f'cycle 1 (grey) and cycle {len(self)}')
        for axes in (left, right):
            axes.grid(which='both', alpha=0.3)
        return figure


def simulate(
    machine: Machine,
    motion: PlannedMotion | str | Path | None = None,
    *,
    cycles: int = 1,
    controller: str | Path | Mapping[str, Any] | Controller = 'robust',
    law: str | Path | LearningLaw | None = None,
    seed: int = 1,
    environment: str = 'nominal',
    initial_feedforward: Array | None = None,
    laser: bool = False,
) -> Simulation:
    """
    Return `cycles` simulated cycles of a motion, from power-up at home.

    Controllers, learning laws and plant are those of the cell, called in its order: the same seed and configuration
    give the same bits as `pkm run`. Source: thesis (7.21)-(7.25) (robust control), (7.13)-(7.17) (computed torque),
    (7.31)-(7.33) (learning).

    Parameters
    ----------
    machine : Machine
        From `load_machine`.
    motion : PlannedMotion or str or Path, optional
        From `plan`, or what `plan` takes.
    cycles : int
        How many, from 1.
    controller : str or Path or mapping or Controller
        'robust', 'observer' or 'computed_torque' with the machine's gains, a name or YAML file of gains,
        {joint: gains}, or an own `Controller`.
    law : str or Path or LearningLaw, optional
        Name of a file in config/learning, a YAML file, or an own `LearningLaw`; None or 'none' learns nothing.
    seed : int
        Of noise, friction and assembly of the simulated machine, from 0.
    environment : str
        Level of imperfections: 'ideal', 'exact', 'nominal', 'hard', 'geometric', 'warm' and 'flexible' (not xy_stage),
        and for four_dof 'elastic'.
    initial_feedforward : array_like, shape (N, n), optional
        Learned feedforward of the first cycle [V]; by default none.
    laser : bool
        Whether the end point is measured; the simulation then takes twice as long.

    Raises
    ------
    ConfigError
        If a name is unknown or a file is refused.
    TrajectoryError
        If the motion is for another machine.
    LearningError
        If the law is refused or would diverge on a model of an axis, or an own law returns what is no feedforward.
    PkmError
        If an argument is refused, the simulated machine stops with a fault, or an own controller returns what is no
        voltage; cycle and sample are named.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> machine = pkm.load_machine('xy_stage')
    >>> motion = pkm.plan(machine, 'xy_stage_100ms')
    >>> result = pkm.simulate(machine, motion, cycles=2, law='fourier_pid', seed=3)
    >>> bool((result.max_dynamic_error[1] < result.max_dynamic_error[0]).all())
    True

    """
    if not isinstance(motion, PlannedMotion):
        motion = plan(machine, motion)
    if motion.machine != machine.name:
        raise TrajectoryError(f'simulate: motion is for {motion.machine}; the machine is {machine.name}')
    cycles, seed = checked_count('simulate: cycles', cycles, 1), checked_count('simulate: seed', seed, 0)
    if initial_feedforward is not None:
        shape = motion.joints.position.shape
        initial_feedforward = checked_array('simulate: initial_feedforward', initial_feedforward, shape)
    gains, own, controller_name = _controller(machine, controller)
    chosen, law_name = _law(machine, gains, law)
    records = run_cycles(
        machine, motion.joints, gains, chosen, cycles, seed, environment, initial_feedforward, laser, controller=own
    )
    return Simulation(
        motion=motion,
        controller=controller_name,
        law=law_name,
        seed=seed,
        environment=environment,
        records=records,
        encoder_resolution=machine.encoder_resolution,
        coordinates=machine.coordinates,
    )


def _controller(machine: Machine, given: Any) -> tuple[Any, Any, str]:
    """Return (gains, own controller, name); one of the first two is None."""
    if isinstance(given, str | Path):
        return choose_control(machine, str(given)), None, Path(given).stem
    if isinstance(given, Mapping):
        if set(given) != set(machine.joints):
            raise PkmError(f'simulate: controller has gains of {sorted(given)}; expected {list(machine.joints)}')
        return {joint: given[joint] for joint in machine.joints}, None, 'given gains'
    return None, own_controller(machine, given), type(given).__name__


def _law(machine: Machine, gains: Any, given: Any) -> tuple[Any, str]:
    """Return (law, name); `gains` is None with an own controller."""
    if given is None or given == 'none':
        return None, 'none'
    if isinstance(given, str | Path):
        if gains is None:
            raise LearningError(
                f'simulate: law {str(given)!r} is designed for gains of robust control, an own controller has none; '
                f"allowed with it: 'none' or an own law"
            )
        if not all(isinstance(axis_gains, AxisLaw) for axis_gains in gains.values()):
            raise LearningError(
                f'simulate: law {str(given)!r} with computed torque; only controllers of single axes learn'
            )
        return make_law(str(given), machine, gains), Path(given).stem
    return own_law(machine, given), type(given).__name__
