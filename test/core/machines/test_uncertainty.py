"""Uncertainty of measured lengths as a section of a machine file."""

import numpy as np
import pytest

from pkm_core.config import parse_config
from pkm_core.errors import ConfigError
from pkm_core.machines.uncertainty import Uncertainty
from pkm_core.yaml_text import parse_yaml

NAMES = ('l2', 'l4', 'd1')
COVARIANCE = 1e-12 * np.array([[4.0, 1.0, -0.5], [1.0, 9.0, 0.2], [-0.5, 0.2, 1.0]])


def written(lines):
    return parse_config(parse_yaml('\n'.join(lines))['uncertainty'], Uncertainty, where='planar.yaml')


def test_written_section_holds_the_covariance():
    found = written(Uncertainty.of(NAMES, COVARIANCE).lines(''))
    assert tuple(found.deviations) == NAMES
    assert found.covariance == pytest.approx(COVARIANCE, rel=1e-6, abs=1e-20)


def test_exactly_known_length_has_no_correlation():
    covariance = COVARIANCE.copy()
    covariance[1, :] = covariance[:, 1] = 0.0
    assert Uncertainty.of(NAMES, covariance).covariance == pytest.approx(covariance, abs=1e-20)


@pytest.mark.parametrize(
    ('deviations', 'rows', 'reason'),
    [
        ('{l2: 1 um, l4: 2 um}', '[[0.1], [0.2, 0.3]]', r'correlations in rows of \[1, 2\]; expected \[1\]'),
        ('{l2: 1 um, l4: 2 um}', '[[1.1]]', r'uncertainty\.correlations|correlations\.0\.0: 1\.1'),
        ('{l2: -1 um, l4: 2 um}', '[[0.1]]', r"deviations\.l2: '-1 um' given"),
        ('{l2: 1, l4: 2 um}', '[[0.1]]', r'deviations\.l2: 1 has no unit'),
        ('{l2: 1 um, l4: 1 um, d1: 1 um}', '[[0.9], [0.9, -0.9]]', 'correlations contradict each other'),
    ],
)
def test_impossible_section_is_refused(deviations, rows, reason):
    with pytest.raises(ConfigError, match=reason):
        written(['uncertainty:', f'  deviations: {deviations}', f'  correlations: {rows}'])
