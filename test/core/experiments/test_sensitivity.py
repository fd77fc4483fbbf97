"""Sensitivity: every chosen constant takes part, its levels are valid, and only the plant changes."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from pkm_core.experiments.condition import conditions
from pkm_core.experiments.outcome import worst_axis
from pkm_core.experiments.runs import measure
from pkm_core.experiments.sensitivity import (
    CONSTANTS,
    ENVIRONMENT,
    LEVELS,
    by_effect,
    learned_error,
    sensitivity_report,
    sensitivity_tasks,
)
from pkm_core.experiments.sensitivity_figure import draw_sensitivity
from pkm_core.machines import load_machine
from pkm_core.plant.changed_truth import changed_machine
from pkm_core.plant.truth import load_truth

# constants that act on the end point, at the stops or in other environments, not on an encoder in motion
ELSEWHERE = {
    'belts', 'carriage_length', 'carriages', 'clearance', 'continuous_current', 'encoder_offset', 'laser_noise',
    'link_error', 'resolution', 'rotation_arm',
}  # fmt: skip
SECTIONS_ELSEWHERE = {'stops', 'platform', 'laser', 'belts'}
# the switch of both errors of an axis, and its direction, which the drawing gives
COVERED = {'model_error', 'direction'}


def chosen_keys(path):
    """Return the keys with the comment 'chosen' outside other environments than the nominal one."""
    keys, section, environment = set(), '', ''
    for line in path.read_text(encoding='utf-8').splitlines():
        found = re.match(r'( *)(?:- )?([a-z_0-9]+):', line)
        if not found:
            continue
        indent, key = found.groups()
        if not indent:
            section = key
        if section == 'environments' and len(indent) == 2:
            environment = key
        elsewhere = section in SECTIONS_ELSEWHERE or (section == 'environments' and environment != ENVIRONMENT)
        if '# chosen' in line and not elsewhere:
            keys.add(key)
    return keys


@pytest.mark.parametrize('name', ['four_dof', 'planar'])
def test_every_chosen_constant_takes_part(name):
    machine = load_machine(name)
    varied = {key.split('.')[-1] for constant in CONSTANTS for key in constant.keys}
    chosen = chosen_keys(machine.configuration.find('truth', name))
    assert {'coulomb_friction', 'resonance', 'stribeck_speed'} <= chosen
    assert chosen <= varied | ELSEWHERE | COVERED


@pytest.mark.parametrize('name', ['four_dof', 'planar'])
def test_every_level_is_valid_and_differs_from_the_shipped(name):
    machine = load_machine(name)
    shipped = load_truth(machine, ENVIRONMENT)
    for constant in CONSTANTS:
        for level in LEVELS:
            if getattr(constant, level) is not None:
                with changed_machine(machine, ENVIRONMENT, constant.applied(level)) as changed:
                    assert load_truth(changed, ENVIRONMENT) != shipped, (constant.name, level)


def test_factor_acts_on_every_axis_and_mode():
    machine = load_machine('four_dof')
    frequencies = {constant.name: constant for constant in CONSTANTS}['frequencies of the modes']
    with changed_machine(machine, ENVIRONMENT, frequencies.applied('high')) as changed:
        scaled = load_truth(changed, ENVIRONMENT)[0].axes
    for joint, axis in load_truth(machine, ENVIRONMENT)[0].axes.items():
        for before, after in zip(axis.modes, scaled[joint].modes, strict=True):
            assert after.resonance == pytest.approx(1.05 * before.resonance, rel=1e-12)
            assert after.antiresonance == pytest.approx(1.05 * before.antiresonance, rel=1e-12)
            assert after.resonance_damping == before.resonance_damping


def test_shipped_error_is_that_of_the_experiment():
    best = {each.name: each for each in conditions('planar')}['best law']
    shipped = learned_error('planar', 'shipped', '', 1, 1)
    np.testing.assert_array_equal(shipped, worst_axis([measure(best, 1, 1, laser=False)])[0, best.settled :])
    assert learned_error('planar', 'Coulomb friction', 'high', 1, 1) > 1.2 * shipped


def test_report_lists_the_largest_effect_first(tmp_path):
    spread = lambda mean: SimpleNamespace(mean=mean, p95=mean)  # noqa: E731
    rows = {(name, level): spread(0.85) for _, name, level, _ in sensitivity_tasks(1, 1)}
    rows['ripple', 'low'] = spread(0.1)
    rows['modes', 'low'] = spread(1.0)
    assert [constant.name for constant, _ in by_effect(rows)][:2] == ['ripple', 'modes']
    (table,), figures = sensitivity_report({'planar': rows}, 1, 1)
    assert table.rows[0] == ['ripple', '0 %', '0.10 (0.10)', '3 %', '0.85 (0.85)']
    assert table.rows[1] == ['modes', 'off', '1.00 (1.00)', '', '']
    assert figures['planar']['ripple low'] == {'mean_um': 0.1, 'p95_um': 0.1}
    draw_sensitivity(tmp_path, {'four_dof': rows, 'planar': rows})
    assert (tmp_path / 'sensitivity.png').stat().st_size > 10_000
