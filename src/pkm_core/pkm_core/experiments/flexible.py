"""
What modes in series hide: margins and errors of the shipped controllers on modes that react and are shared.

`series` is the environment nominal. The other cases are the environment flexible, with its modes shared by the two
sliders of a link pair to 0, 50 and 100 %. Controllers, models and learning law stay as shipped. Margins are those of
all loops together, on the linear machine of the truth without friction and gain errors.
"""

from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from pkm_core.control.margins import design_grid, measured_margins, unit_circle
from pkm_core.experiments.condition import conditions, prepared
from pkm_core.experiments.outcome import spread
from pkm_core.plant.changed_truth import changed_machine
from pkm_core.plant.linear import pair_gaps, sampled_plants
from pkm_core.reporting.tables import Table
from pkm_core.simulation.cycles import run_cycles

MACHINES = {'four_dof': '4-DOF', 'planar': 'planar'}
CASES = {'series': None, 'shared 0 %': '0 %', 'shared 50 %': '50 %', 'shared 100 %': '100 %'}
POSES = 50  # of the workspace, drawn
_STEP, _HIGHEST = 0.02, 20.0  # [dB] of the search for the gain margin


@dataclass(frozen=True)
class Loops:
    """Gain margins [dB] of one machine with all loops closed."""

    axis: float  # of the worst axis at home, when the gain of that axis alone rises
    home: float  # at home, when all gains rise together
    worst: float  # the same at the worst pose
    gap: float  # [m] between the sliders of the widest pair at that pose
    unstable: int  # of POSES poses


def flexible_tasks(seeds, cycles):
    """Return {key: tuple of a function and its arguments} of all runs, for `farm`; a key is (machine, case, seed)."""
    keys = [(machine, case, seed) for machine in MACHINES for case in CASES for seed in range(seeds + 1)]
    return {key: (errors, *key, cycles) if key[2] else (loops, *key[:2]) for key in keys}


def errors(name, case, seed, cycles):
    """Return the largest error [m] of the worst axis by cycle, best law; the last `cycles` are counted."""
    condition = {each.name: each for each in conditions(name)}['best law']
    given = prepared(condition)
    with _built(given.machine, case) as (machine, environment):
        records = run_cycles(
            machine, given.joints, given.gains, given.law, condition.settled + cycles, seed, environment, given.start
        )
    return records.metric('max_dynamic_error').max(axis=1)


def loops(name, case):
    """Return the `Loops` of the shipped controllers of a machine."""
    given = prepared({each.name: each for each in conditions(name)}['best law'])
    with _built(given.machine, case) as (machine, environment):
        laws = [law.system(machine.sample_time) for law in given.gains.values()]
        poses = _poses(machine)
        home, *plants = sampled_plants(machine, environment, [machine.home, *poses])
    margins = np.array([together(plant, laws) for plant in plants])
    worst = int(np.argmin(margins))
    return Loops(
        alone(home, laws, given.machine.sample_time),
        together(home, laws),
        float(margins[worst]),
        float(pair_gaps(given.machine, poses[worst]).max()),
        int((margins <= 0.0).sum()),
    )


@contextmanager
def _built(machine, case):
    """Yield (machine, environment) of a case."""
    if CASES[case] is None:
        yield machine, 'nominal'
        return

    def change(truth):
        truth['environments']['flexible']['flexible']['shared'] = CASES[case]

    with changed_machine(machine, 'flexible', change) as changed:
        yield changed, 'flexible'


def _poses(machine):
    """Return joint positions (POSES, n) in the travel, the same in every case."""
    return np.random.default_rng(1).uniform(machine.limits.lower, machine.limits.upper, (POSES, len(machine.joints)))


def together(plant, laws):
    """Return the gain margin [dB] when the gains of all `laws` rise together; 0 if the loops are unstable as given."""
    stable, unstable = 0.0, _HIGHEST
    if not _is_stable(plant, laws, 0.0):
        return 0.0
    while unstable - stable > _STEP:
        level = 0.5 * (stable + unstable)
        stable, unstable = (level, unstable) if _is_stable(plant, laws, level) else (stable, level)
    return stable


def _is_stable(plant, laws, level):
    """Return whether the loops are stable with all gains raised by `level` [dB]."""
    return np.abs(np.linalg.eigvals(_closed(plant, laws, 10 ** (level / 20)))).max() < 1.0


def alone(plant, laws, sample_time):
    """Return the least gain margin [dB] over the axes, each opened with the other loops closed."""
    A, B, C = plant
    frequency = design_grid(sample_time)
    z = unit_circle(frequency, sample_time)
    P = C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (z.size, *B.shape)))
    L = P * np.array([law(z) for law in laws]).T[:, None, :]
    margins, n = [], len(laws)
    for i in range(n):
        others = [k for k in range(n) if k != i]
        closed = np.linalg.solve(np.eye(n - 1) + L[:, others][:, :, others], L[:, others, i][:, :, None])
        loop = L[:, i, i] - (L[:, i, others][:, None, :] @ closed)[:, 0, 0]
        margins.append(measured_margins(frequency, loop).gain_margin)
    return float(min(margins))


def _closed(plant, laws, gain):
    """Return the matrix (N, N) of the closed loops; `gain` multiplies all laws."""
    A, B, C = plant
    feed = block_diag(*(law.B for law in laws))
    read = gain * block_diag(*(law.C for law in laws))
    straight = gain * np.diag([law.D for law in laws])
    return np.block([[A - B @ straight @ C, B @ read], [-feed @ C, block_diag(*(law.A for law in laws))]])


def flexible_report(results, seeds, cycles):
    """Return ([`Table`], figures) for {key: result} of `flexible_tasks`."""
    rows, data = [], []
    for machine, name in MACHINES.items():
        for case in CASES:
            found = results[machine, case, 0]
            runs = 1e6 * np.array([results[machine, case, seed] for seed in range(1, seeds + 1)])
            before, after = spread(runs[:, 0]), spread(runs[:, -cycles:])
            rows.append([
                *(name, case, f'{found.axis:.2f}', f'{found.home:.2f}', f'{found.worst:.2f}'),
                *(f'{1e3 * found.gap:.0f}', str(found.unstable)),
                *(f'{each.mean:.2f} ({each.p95:.2f})' for each in (before, after)),
            ])  # fmt: skip
            data.append({
                'machine': machine,
                'case': case,
                **vars(found),
                'before_um': (before.mean, before.p95),
                'after_um': (after.mean, after.p95),
            })  # fmt: skip
    title = (
        f'Modes in series and modes that react: gain margin [dB] of the shipped controllers with all loops closed, and '
        f'largest error of the worst axis by the encoders, mean (95 %) um of {seeds} seeds and {cycles} cycles'
    )
    headings = ['', 'modes', 'one axis, home', 'all axes, home', 'all axes, worst pose', 'gap there, mm',
                f'unstable of {POSES} poses', 'cycle 1', 'after learning']  # fmt: skip
    return [Table(title, headings, rows)], {'experiment': 'flexible', 'seeds': seeds, 'cycles': cycles, 'rows': data}
