"""Modes in series and modes that react: margins of the shipped loops, and the table of given runs."""

import numpy as np
import pytest

from pkm_core.control.margins import stability_margins
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.experiments.flexible import (
    CASES,
    MACHINES,
    Loops,
    alone,
    errors,
    flexible_report,
    flexible_tasks,
    together,
)
from pkm_core.experiments.sensitivity import learned_error
from pkm_core.machines import load_machine
from pkm_core.plant.linear import sampled_plants


@pytest.mark.parametrize('name', list(MACHINES))
def test_shared_modes_take_margin_that_the_series_model_hides(name):
    """At home. In series it is the margin of the models of the controllers, but for the coupling of the axes."""
    machine = load_machine(name)
    gains, models = load_control(machine), load_model(machine)
    laws = [law.system(machine.sample_time) for law in gains.values()]
    series, shared = (
        sampled_plants(machine, environment, [machine.home])[0] for environment in ('nominal', 'flexible')
    )
    by_model = min(stability_margins(gains[j], models[j], machine.sample_time).gain_margin for j in machine.joints)
    assert alone(series, laws, machine.sample_time) == pytest.approx(by_model, abs=0.1)
    assert together(shared, laws) < together(series, laws) - 0.5


def test_series_case_is_the_shipped_experiment():
    np.testing.assert_array_equal(errors('planar', 'series', 1, 1)[-1:], learned_error('planar', 'shipped', '', 1, 1))
    assert errors('planar', 'shared 100 %', 1, 1)[0] != errors('planar', 'series', 1, 1)[0]


def test_report_has_margins_and_errors_of_every_case():
    tasks = flexible_tasks(2, 3)
    assert len(tasks) == len(MACHINES) * len(CASES) * 3
    found = {
        key: np.array([9e-6, 2e-6, 1e-6, 1e-6, 1e-6]) if key[2] else Loops(8.5, 8.0, 7.0, 0.09, 1) for key in tasks
    }
    (table,), figures = flexible_report(found, 2, 3)
    assert table.rows[0][1:] == ['series', '8.50', '8.00', '7.00', '90', '1', '9.00 (9.00)', '1.00 (1.00)']
    assert figures['rows'][-1]['case'] == 'shared 100 %'
