"""PID beside observer: one machine as shipped, and the table of given runs."""

import numpy as np

from pkm_core.experiments.structures import CYCLES, LAWS, Run, compare, structure_tasks, structures_report
from pkm_core.machines import load_machine
from pkm_core.plant.random_truth import random_machine
from pkm_core.plant.truth import load_truth


def test_observer_lowers_the_error_that_does_not_repeat():
    """Planar, hard, cycles 4 to 13; by a third on this seed, by 0.8 for other noise."""
    run = compare('planar', 'hard', 'shipped', 0)
    pid, observer = (run.error[law][3:13].mean() for law in LAWS)
    assert observer < 0.8 * pid
    assert run.refused == {}


def test_report_counts_refusals_and_divergence():
    fine, far = np.full(CYCLES, 1e-6), np.full(CYCLES, 80e-6)
    runs = [
        Run({'PID': fine, 'observer': far}, {}),
        Run({'PID': 3 * fine}, {'observer': 'd1: unstable'}),
    ]
    keys = [('planar', 'hard', 'wide', number) for number in range(2)]
    (table,), figures = structures_report(dict(zip(keys, runs, strict=True)), 1)
    pid, observer = (row for row in table.rows if row[:3] == ['planar', 'hard', 'wide'])
    assert pid[3:] == ['PID', *['2.00 (3.00)'] * 5, '0', '0']
    assert observer[-2:] == ['1', '1']
    assert [row['refused'] for row in figures['rows'] if row.get('beyond') == 1] == [['d1: unstable']]


def test_every_case_of_every_machine_has_its_runs():
    assert len(structure_tasks(1)) == (3 + 2) * (1 + 1 + 2)


def test_wide_machine_has_other_modes_viscosity_and_friction():
    """Friction is relative to that of the environment."""
    machine = load_machine('planar')
    with random_machine(machine, 1, 'hard', wide=True) as drawn:
        (wide, wide_level), (usual, level) = (load_truth(each, 'hard') for each in (drawn, machine))
    assert 0.5 <= wide_level.coulomb_friction / level.coulomb_friction <= 3.0
    for joint, axis in wide.axes.items():
        assert axis.viscosity_error != usual.axes[joint].viscosity_error
        shifts = [a.resonance / b.resonance - 1 for a, b in zip(axis.modes, usual.axes[joint].modes, strict=True)]
        assert all(0 < abs(shift) <= 0.1 for shift in shifts)
