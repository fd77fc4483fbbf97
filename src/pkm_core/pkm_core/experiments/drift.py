"""
Drift of a machine that warms up: one hour of moves without pause, with and without recalibration and learning.

Every run is another specimen, calibrated cold. After `LEARNING` cycles one cycle every `EVERY` is simulated; in between
the machine repeats it, and its mean losses warm the machine exactly as the thermal model has it. Motions between
are not simulated, and nothing is learned from them. The judge alone reads the truth.

Three errors are distinct, phi on 50 mm:

- the drift of home: the end point at rest at home, from where it was at power-up,
- the error of the move: the largest of a cycle, counted from the rest before the first move,
- the error at rest: root mean square at `OTHERS` poses over the travel, less the mean error.
"""

from typing import NamedTuple

import numpy as np

from pkm_core.control.robust import load_control
from pkm_core.design.budget import linear_budget
from pkm_core.design.calibration import calibrate
from pkm_core.design.measurement import load_laser
from pkm_core.design.pose_plan import spread_poses
from pkm_core.design.tolerances import load_tolerances
from pkm_core.experiments.condition import conditions, motion_of
from pkm_core.experiments.tool_targets import calibrated, calibration_poses, in_move
from pkm_core.learning import make_law
from pkm_core.learning.tool import ToolLearning, make_tool_law
from pkm_core.machines import load_machine
from pkm_core.machines.checks import ANGLES
from pkm_core.motion.planning import plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.plant.plant import Plant
from pkm_core.reporting.histories import ARM
from pkm_core.simulation.calibration import measure_poses
from pkm_core.simulation.cycles import run_cycles
from pkm_core.simulation.true_rests import true_poses

MACHINES = {'four_dof': '4-DOF', 'planar': 'planar'}
ENVIRONMENT = 'warm'
MOVE_TIME = 30e-3  # [s] the shortest moves of the targets, with the largest losses
LEARNING = 10  # cycles before the hour
HOUR, EVERY = 3600.0, 20.0  # [s]
MINUTES = (0, 5, 15, 30, 60)  # of the tables
RUNS = ('fixed', 'joints', 'tool')  # by what learns within the hour: nothing, the joints, the joints and the tool
RECALIBRATED = 'recalibrated'
OTHERS, _OTHER_SEED = 50, 2
TIMES = np.arange(round(HOUR / EVERY) + 1) * EVERY  # [s] of the simulated cycles


class DriftRun(NamedTuple):
    """One specimen over the hour; one row per simulated cycle, m coordinates, rotations on `ARM`."""

    nodes: tuple[str, ...]
    temperatures: np.ndarray  # (cycles, nodes) [K] over ambient
    home: np.ndarray  # (cycles, m) [m] drift by the truth
    laser: np.ndarray  # (cycles, m) [m] the same by laser
    error: np.ndarray  # (cycles, m) [m] of the move, by the truth


class Recalibrated(NamedTuple):
    """One specimen calibrated again at each of `MINUTES`; m coordinates, rotations on `ARM`."""

    error: np.ndarray  # (len(MINUTES), cycles, m) [m] of the move, by the truth
    rest: np.ndarray  # (len(MINUTES), m) [m] at rest, by the truth
    rest_before: np.ndarray  # (len(MINUTES), m) [m] the same with the calibration of the cold machine


def drift_tasks(seeds, cycles):
    """Return {key: tuple of a function and its arguments} of all runs, for `farm`; a key is (machine, run, seed)."""
    tasks: dict[tuple, tuple] = {}
    for machine in MACHINES:
        for seed in range(1, seeds + 1):
            tasks |= {(machine, run, seed): (drift_run, machine, run, seed) for run in RUNS}
            tasks[machine, RECALIBRATED, seed] = (recalibrated_run, machine, seed, cycles)
    return tasks


def drift_run(name, run, seed):
    """Return the `DriftRun` of the machine `name`, one of `RUNS`, with specimen `seed`."""
    machine, poses, joints, gains, law = _prepared(name, calibrated(name, ENVIRONMENT, seed)[0])
    given: dict = {'law': law}
    if run == 'fixed':
        given = {'law': None, 'start': _learned(machine, joints, gains, law, seed)}
    elif run == 'tool':
        given['tool'] = ToolLearning(make_tool_law(machine, gains, law, poses, joints))
    ran = _hour(machine, joints, gains, seed, laser=True, **given)
    scale, start = _scale(machine), poses.move_starts[0]
    before = [  # of the first move
        time < (cycle * len(poses) + start) * machine.sample_time for cycle, (time, _) in enumerate(ran.laser)
    ]
    seen = [scale * laser[rest].mean(axis=0) for (_, laser), rest in zip(ran.laser, before, strict=True)]
    return DriftRun(
        tuple(ran.temperatures[0]),
        np.array([list(each.values()) for each in ran.temperatures[LEARNING:]]),
        scale * np.array([true[:start].mean(axis=0) for true in ran.truth[LEARNING:]]),
        np.array(seen[LEARNING:]),
        _move_errors(machine, poses, ran.truth[LEARNING:]),
    )


def recalibrated_run(name, seed, cycles):
    """
    Return the `Recalibrated` of the machine `name` with specimen `seed`, with `cycles` counted cycles.

    The joints learn again for `LEARNING` cycles before them.
    """
    cold = calibrated(name, ENVIRONMENT, seed)[0]
    machine, _, joints, gains, law = _prepared(name, cold)
    ran = _hour(machine, joints, gains, seed, law=None, start=_learned(machine, joints, gains, law, seed))
    errors, rests, before = [], [], []
    for minute in MINUTES:
        rise = list(ran.temperatures[LEARNING + _row(minute)].values())
        poses = calibration_poses(name, ENVIRONMENT)
        seen = measure_poses(load_machine(name), poses, load_laser(), seed, ENVIRONMENT, rise=rise)
        found = calibrate(load_machine(name), seen, load_tolerances(), seen.deviation).machine
        machine, poses, joints, gains, law = _prepared(name, found)
        again = run_cycles(machine, joints, gains, law, LEARNING + cycles, seed, ENVIRONMENT, laser=True, rise=rise)
        errors.append(_move_errors(machine, poses, again.truth[LEARNING:]))
        rests.append(_rest_error(found, seed, rise))
        before.append(_rest_error(cold, seed, rise))
    return Recalibrated(*map(np.array, (errors, rests, before)))


def window(minute, cycles):
    """Return the slice of the rows of a `DriftRun` that the table counts at `minute`: `cycles` from then on."""
    cycles = min(cycles, len(TIMES))
    first = min(_row(minute), len(TIMES) - cycles)
    return slice(first, first + cycles)


def per_kelvin(name):
    """Return the shift (m,) [m, rad] at home of a plant with links and offsets 1 K warmer, and that of the budget."""
    machine = load_machine(name)
    cold = Plant(machine, 1, ENVIRONMENT)
    rise = [float(node.startswith('link') or node == 'platform') for node in cold.temperatures]
    tolerances = load_tolerances()
    budget = linear_budget(machine, tolerances, machine.home[np.newaxis])
    row = [source.name for source in budget.sources].index('links warm')
    spread = budget.sources[row].spread.deviation
    return Plant(machine, 1, ENVIRONMENT, rise).truth.pose - cold.truth.pose, budget.deviations[row, 0] / spread


def _row(minute):
    return round(60.0 * minute / EVERY)


def _prepared(name, machine):
    """Return (machine, poses, joints, gains, law) of the move with the best law."""
    best = next(each for each in conditions(name) if each.name == 'best law')
    gains, poses = load_control(machine), plan(machine, motion_of(machine, MOVE_TIME)[1])
    return machine, poses, to_joints(machine, poses), gains, make_law(best.law, machine, gains)


def _learned(machine, joints, gains, law, seed):
    """Return the feedforward (N, n) [V] learned by the cold machine."""
    return run_cycles(machine, joints, gains, law, LEARNING, seed, ENVIRONMENT).feedforward[-1]


def _hour(machine, joints, gains, seed, *, law, **given):
    """Return the `CycleRecords` of the cycles of learning, and of those at `TIMES`."""
    cycles = LEARNING + len(TIMES)
    pauses = np.full(cycles - 1, EVERY - len(joints) * machine.sample_time)
    pauses[:LEARNING] = 0.0
    return run_cycles(machine, joints, gains, law, cycles, seed, ENVIRONMENT, pauses=pauses, **given)


def _move_errors(machine, poses, truths):
    """Return the largest error (cycles, m) [m] of every cycle during its moves."""
    way, moving = poses.position - poses.position[0], in_move(poses, np.arange(len(poses)))
    off = [way - true + true[: poses.move_starts[0]].mean(axis=0) for true in truths]
    return _scale(machine) * np.abs(np.array(off)[:, moving]).max(axis=1)


def _rest_error(machine, seed, rise):
    """Return the error at rest (m,) [m] of the specimen of `seed` at the temperatures `rise`, sent by `machine`."""
    wanted = spread_poses(load_machine(machine.name), OTHERS, _OTHER_SEED)
    errors = true_poses(machine, machine.inverse(wanted), seed, ENVIRONMENT, rise) - wanted
    return _scale(machine) * np.sqrt(np.mean((errors - errors.mean(axis=0)) ** 2, axis=0))


def _scale(machine):
    return np.array([ARM if coordinate in ANGLES else 1.0 for coordinate in machine.coordinates])
