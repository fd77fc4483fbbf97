"""A condition of an experiment: one machine with one controller and learning law in one environment."""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from pkm_core.control.controllers import choose_control
from pkm_core.learning import make_law
from pkm_core.learning.coupling import design_feedforward
from pkm_core.learning.law import Law
from pkm_core.machines import load_machine
from pkm_core.machines.base import Machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import SampledTrajectory, to_joints

ENVIRONMENTS = ('nominal', 'exact', 'hard')


@dataclass(frozen=True)
class Condition:
    """
    A condition. `name` is its row in the tables, `column` its column in the thesis's tables, '' without one.

    The first `settled` cycles are not counted: the machine starts from power-up, and a law needs cycles to learn.
    """

    name: str
    machine: str
    column: str = ''
    control: str = 'robust'  # argument of `choose_control`
    law: str = 'none'
    settled: int = 3
    coupled: bool = False  # whether the feedforward includes the coupling of the design, see `design_feedforward`
    environment: str = 'nominal'
    move_time: float | None = None  # [s] instead of that of the machine's default motion


def environments(experiment):
    """Return the environments of the experiment 'planar' or 'four_dof'; `elastic` is one of the 4-DOF machine alone."""
    return (*ENVIRONMENTS, 'elastic') if experiment == 'four_dof' else ENVIRONMENTS


def motion_of(machine, move_time=None):
    """Return name and `Motion`: the default motion of a `Machine`, with another move time [s] if given."""
    name = default_motion(machine)
    motion = load_motion(name)
    return name, motion if move_time is None else motion.model_copy(update={'move_time': move_time})


class Prepared(NamedTuple):
    """The objects of a `Condition`."""

    machine: Machine
    motion: str
    poses: SampledTrajectory
    joints: SampledTrajectory
    gains: dict  # {joint: gains}
    law: Law | None
    start: np.ndarray | None  # (N, n) [V] initial feedforward


def prepared(condition):
    """Return the `Prepared` of a `Condition`; conditions that differ only in the environment share its objects."""
    return _prepared(condition.machine, condition.control, condition.law, condition.coupled, condition.move_time)


@cache
def _prepared(machine_name, chosen, law, coupled, move_time):
    machine = load_machine(machine_name)
    motion_name, motion = motion_of(machine, move_time)
    poses = plan(machine, motion)
    joints, gains = to_joints(machine, poses), choose_control(machine, chosen)
    return Prepared(
        machine,
        motion_name,
        poses,
        joints,
        gains,
        None if law == 'none' else make_law(law, machine, gains),
        design_feedforward(machine, gains, joints) if coupled else None,
    )


def conditions(experiment):
    """Return the `Condition`s of the experiment 'planar' (chapter 7) or 'four_dof' (chapter 8), nominal."""
    stage = {'planar': ('XY stage', 'XY stage'), 'four_dof': ('XY stage', 'single stages')}[experiment]
    best = {'planar': 5, 'four_dof': 3}[experiment]
    return (
        Condition(stage[0], 'xy_stage', stage[1]),
        Condition('computed torque', experiment, 'computed torque', 'computed_torque'),
        Condition('thesis torque', experiment, 'computed torque', f'{experiment}_torque_thesis'),
        Condition('robust', experiment, 'robust'),
        Condition('coupled', experiment, 'robust', coupled=True),
        Condition('thesis law', experiment, 'robust learning', f'{experiment}_thesis', 'fourier', settled=6),
        Condition('best law', experiment, 'robust learning', law='inverse', settled=best),
    )
