"""Targets of real geometry and the measured budget, each with one specimen; rows that are not met."""

import numpy as np
import pytest

from pkm_core.design.tolerances import load_tolerances
from pkm_core.experiments.geometry_targets import COUNTS, geometry_figures, geometry_rows, geometry_tasks
from pkm_core.experiments.measured_budget import measured_rows, measured_tasks


def test_real_geometry_meets_its_targets_for_one_specimen():
    figures = geometry_figures('planar', 1)
    rows = list(geometry_rows('planar', 'planar', [figures]))
    assert [met for *_, met in rows] == [True] * 3
    assert 'calibrated with 20, 1 specimens' in rows[0][0]
    assert '2 of 2 refused, misfit' in rows[2][2]
    assert 'pose' in rows[2][2]  # the pattern of the residuals
    assert (figures[COUNTS[0]]['before'] > 5.0 * figures[COUNTS[0]]['after']).all()
    assert len(geometry_tasks('planar', 5)) == 50


def test_rows_of_real_geometry_show_what_is_not_met():
    good = {'before': np.ones(2), 'after': np.array([0.1e-6, 0.1e-6]), 'lengths': 'misfit 9.5 of the noise'}
    bad = {'before': np.ones(2), 'after': np.array([0.1e-6, 0.5e-6]), 'lengths': ''}
    results = [{20: bad, 60: {'refused': 'calibration: misfit 1.6'}}, {20: bad, 60: good}]
    twenty, sixty, lengths = geometry_rows('planar', 'planar', results)
    assert not twenty[3]
    assert 'y 0.50 (0.50) um, 0 refused' in twenty[2]
    assert not sixty[3]
    assert 'x 0.10 (0.10), y 0.10 (0.10) um, 1 refused' in sixty[2]
    assert not lengths[3]
    assert lengths[2].startswith('1 of 3 refused, misfit 9.5 to 9.5')


@pytest.mark.parametrize('environment', ['nominal', 'geometric'])
def test_measured_budget_is_near_its_prediction(environment):
    """One specimen: its drawing within the spread of a normal, its calibration within a factor of two."""
    tolerances = load_tolerances()
    ((run, *arguments),) = measured_tasks('planar', tolerances, environment, 1)
    rows = measured_rows('planar', tolerances, environment, [run(*arguments)])
    assert (rows['drawing, measured'] < 3.0 * rows['drawing, predicted']).all()
    ratio = rows['calibrated, measured'] / rows['calibrated, predicted with the rest of the axes']
    assert (ratio > 0.5).all()
    assert (ratio < 2.0).all()
    assert (rows['calibrated, measured'] < 0.2 * rows['drawing, measured']).all()
