"""
The thesis's claim that its parallel machine settles faster than the XY stage, over the assumptions about the stage.

Settling is that of Table 7.3: the end point by the laser, to 5 um after the end of a move, both under the robust law
with gains of the same search. `exact` machines, so that the links of the planar machine are as drawn.
"""

from dataclasses import dataclass, replace

import numpy as np

from pkm_core.experiments.condition import Condition, conditions
from pkm_core.experiments.outcome import Spread, outcome, spread
from pkm_core.experiments.runs import measure
from pkm_core.experiments.simulated import simulate_prepared
from pkm_core.experiments.stage_assumptions import ENVIRONMENT, SHIPPED, STAGE, Assumptions, stage
from pkm_core.thesis.results import END_POINT

MS = 1e3
FRICTIONS = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # [N]
MODES = (90.0, 100.0, 110.0, 120.0, 130.0, 140.0, 160.0, 190.0, 220.0)  # [Hz]
MAP_CYCLES = 3  # counted, of noise seed 1
LATE = 110.0  # [Hz] first mode with which the stage settles about as late as that of the thesis
ROWS = {  # one assumption at a time
    'as shipped: 2 N, 220 Hz, 8.2 and 3.0 kg, 100 ms': SHIPPED,
    'friction 0 N': replace(SHIPPED, friction=0.0),
    'friction 8 N': replace(SHIPPED, friction=8.0),
    'friction 32 N': replace(SHIPPED, friction=32.0),
    'first mode 160 Hz': replace(SHIPPED, mode=160.0),
    'first mode 110 Hz': replace(SHIPPED, mode=LATE),
    'first mode 110 Hz, no friction': replace(SHIPPED, mode=LATE, friction=0.0),
    'a third of the damping': replace(SHIPPED, damping=1.0 / 3.0),
    'twice the damping': replace(SHIPPED, damping=2.0),
    'half the masses': replace(SHIPPED, masses=(4.1, 1.5)),
    '1.4 times the masses': replace(SHIPPED, masses=(11.48, 4.2)),
    'move in 85 ms': replace(SHIPPED, move_time=85e-3),
    'integral action of the thesis, KI/KP = 5 1/s': replace(SHIPPED, weak_integral=True),
}
# Z and phi of Table 8.3 as two axes of one stage: 5 mm, and 5 mm at the radius of 50 mm, in the 70 ms of chapter 8.
# The thesis gives no mass and no friction; the guides are small, as those of the parallel machines.
_Z_PHI = Assumptions(friction=0.5, masses=(2.0, 1.0), move=(5e-3, 5e-3), move_time=70e-3)
SINGLE = {'shipped': _Z_PHI, 'late': replace(_Z_PHI, mode=LATE)}
_STAGE = Condition('XY stage', STAGE, 'XY stage', environment=ENVIRONMENT)


@dataclass(frozen=True)
class Claim:
    """Settling [ms] of the end point; a pair is that of (x, y), of single stages that of (z, phi)."""

    rows: dict[str, tuple[Spread, Spread]]  # by key of `ROWS`
    cells: dict[tuple[float, float], tuple[Spread, Spread]]  # by friction [N] and mode [Hz]
    single: dict[str, tuple[Spread, Spread]]  # by key of `SINGLE`
    planar: tuple[Spread, Spread]
    planar_weak: tuple[Spread, Spread]  # with the gains of config/control/planar_thesis, whose integral action is weak
    four_dof: dict[str, Spread]  # by coordinate


def loops():
    """Return the distinct `Assumptions.loop`, that of the shipped stage first."""
    cells = [replace(SHIPPED, mode=mode) for mode in MODES]
    return list(dict.fromkeys(each.loop for each in (*ROWS.values(), *SINGLE.values(), *cells)))


def claim_tasks(gains, seeds, cycles):
    """Return {key: tuple of a function and its arguments} for `farm`; `gains` are the results of `tuned` by loop."""
    tasks: dict[tuple, tuple] = {}
    for group, given in (('row', ROWS), ('single', SINGLE)):
        for name, each in given.items():
            for seed in range(1, seeds + 1):
                tasks[group, name, seed] = (stage_settling, each, gains[each.loop], seed, cycles)
    for friction in FRICTIONS:
        for mode in MODES:
            each = replace(SHIPPED, friction=friction, mode=mode)
            tasks['cell', (friction, mode), 1] = (stage_settling, each, gains[each.loop], 1, MAP_CYCLES)
    for machine, control in (('planar', 'robust'), ('planar', 'planar_thesis'), ('four_dof', 'robust')):
        robust = next(each for each in conditions(machine) if each.name == 'robust')
        chosen = replace(robust, environment=ENVIRONMENT, control=control)
        for seed in range(1, seeds + 1):
            tasks[machine, control, seed] = (_settling, chosen, seed, cycles)
    return tasks


def stage_settling(assumptions, gains, seed, cycles):
    """Return settling times [s] (cycles, 2) of the stage, nan: does not settle; `gains` is a result of `tuned`."""
    with stage(assumptions, gains) as given:
        records, notices = simulate_prepared(given, _STAGE, seed, _STAGE.settled + cycles)
        found = outcome(_STAGE, seed, records, notices, given.machine)
    return found.laser['settling_time_5um'][found.counted]


def _settling(condition, seed, cycles):
    found = measure(condition, seed, cycles)
    return found.laser['settling_time_5um'][found.counted]


def claim(results):
    """Return the `Claim` for {key: result} of `claim_tasks`."""
    found: dict = {}
    for (group, name, _), times in results.items():
        found.setdefault(group, {}).setdefault(name, []).append(times)
    pairs = {group: {name: _spreads(runs) for name, runs in each.items()} for group, each in found.items()}
    four_dof = dict(zip(('x', 'y', 'z', 'phi'), pairs['four_dof']['robust'], strict=True))
    planar = pairs['planar']
    return Claim(pairs['row'], pairs['cell'], pairs['single'], planar['robust'], planar['planar_thesis'], four_dof)


def _spreads(runs):
    return tuple(spread(column, MS) for column in np.concatenate(runs).T)


def holds(found, times):
    """Return for x and y whether a stage with settling `times`, a pair of `Spread`, is later than the planar one."""
    return tuple(bool(each.mean > planar.mean) for each, planar in zip(times, found.planar, strict=True))


def highest_mode(found, friction, axis):
    """Return the highest mode [Hz] of `MODES` with which the stage is later at `friction` in one axis; nan if none."""
    later = [mode for mode in MODES if holds(found, found.cells[friction, mode])[axis]]
    return max(later, default=np.nan)


def thesis_settling(machine, control):
    """Return {coordinate: settling [ms]} of a column of the thesis's Table 7.3 or 8.3."""
    table = END_POINT[machine]
    column = table.columns.index(control)
    return {axis: values[column] for axis, values in table.values['settling_5um_ms'].items()}
