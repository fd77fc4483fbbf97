"""The machine files: their values, and what is refused in them."""

import re

import numpy as np
import pytest

from pkm_core.config import Configuration
from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine

FOLDER = Configuration.of_environment().folder / 'machines'


@pytest.fixture
def edited(tmp_path):
    """Return a function: copy of a machine's file with `old` replaced by `new`, as a path."""

    def write(name, old, new):
        text = (FOLDER / f'{name}.yaml').read_text()
        assert old in text
        path = tmp_path / 'edited.yaml'
        path.write_text(text.replace(old, new, 1))
        return path

    return write


def test_four_dof_file_has_the_nominal_values():
    machine = load_machine('four_dof')
    assert (machine.name, machine.joints) == ('four_dof', ('d1', 'd3', 'd5', 'd7'))
    assert machine.coordinates == ('x', 'y', 'z', 'phi')
    np.testing.assert_allclose(machine.home, [0.0795, 0.1395, 0.1395, 0.0795], rtol=1e-15)
    np.testing.assert_allclose(machine.limits.lower, [0.0595, 0.1195, 0.1195, 0.0595], rtol=1e-15)
    np.testing.assert_allclose(machine.limits.upper, [0.0995, 0.1595, 0.1595, 0.0995], rtol=1e-15)
    assert machine.sample_time == pytest.approx(0.5e-3)
    assert machine.encoder_resolution == pytest.approx(0.2e-6)
    assert machine.voltage_limit == 10.0
    assert machine.thrust_per_volt == pytest.approx(11.0485, abs=1e-4)  # 12.5 N/A rms * 1.25 A/V / sqrt 2
    assert machine.limits.thrust == pytest.approx(110.4854, abs=1e-4)  # at 12.5 A, 10 V
    assert machine.limits.speed == 0.8


def test_xy_stage_amplifier_limits_below_its_full_range():
    stage = load_machine('xy_stage')
    assert stage.limits.thrust / stage.thrust_per_volt == pytest.approx(2.4)  # [V], at 12 A of Table 7.4


def test_machine_of_a_path_has_the_name_of_its_file(edited):
    machine = load_machine(edited('planar', 'mp: 0.034 kg', 'mp: 40 g'))
    assert machine.name == 'edited'
    assert machine.config.masses.mp == pytest.approx(0.040)


def test_arrays_of_a_machine_cannot_be_changed():
    machine = load_machine('planar')
    for array in (machine.home, machine.limits.lower, machine.limits.upper):
        with pytest.raises(ValueError, match='read-only'):
            array[0] = 0.0


def test_dynamic_parameters_follow_their_names():
    machine = load_machine('four_dof')
    p = dict(zip(machine.parameters, machine.dynamic_parameters(), strict=True))
    assert (p['l2'], p['m10'], p['r12'], p['Ief']) == pytest.approx((0.070, 0.147, 0.06977, 7.62e-6))
    assert p['slender'] == 0.0


D1 = 'd1: {lower: 59.5 mm, upper: 99.5 mm, home: 79.5 mm}'
REFUSED = [
    ('four_dof', 'm2: 0.104 kg', 'm2: -0.104 kg', "masses.m2: '-0.104 kg' given; allowed > 0 kg"),
    ('four_dof', 'm2: 0.104 kg', 'm2: 0.104', 'masses.m2: 0.104 has no unit'),
    (
        'four_dof',
        D1,
        D1.replace('59.5 mm', '59.5'),
        "d1.lower: 59.5 has no unit; expected a quantity in mm, e.g. '59.5 mm'",
    ),
    ('four_dof', 'm2: 0.104 kg', 'm2: 0.104 mm', "masses.m2: '0.104 mm' has the dimension of"),
    ('four_dof', 'm2: 0.104 kg', 'm2: .nan kg', 'masses.m2'),
    ('four_dof', '  m2: 0.104 kg', '  mass2: 0.104 kg', 'masses.m2: is missing'),
    ('four_dof', '  m2: 0.104 kg', '  mass2: 0.104 kg', "unknown key 'masses.mass2'; known: ['m1', "),
    ('four_dof', 'encoder_resolution: 0.2 um', 'encoder_resolution: 0 um', "encoder_resolution: '0 um' given"),
    ('four_dof', 'sample_time: 0.5 ms', 'sample_time: 0 ms', "sample_time: '0 ms' given"),
    ('four_dof', 'laser_sample_time: 0.8 ms', 'laser_sample_time: -1 ms', "laser_sample_time: '-1 ms' given"),
    ('four_dof', 'rods_about_vertical: isotropic', 'rods_about_vertical: thin', "'isotropic' or 'slender'"),
    ('four_dof', 'r10: 64.35 mm', 'r10: 164.35 mm', 'geometry: r10 164.35 mm; allowed 0 to k10 116.6 mm'),
    ('four_dof', D1, D1.replace('59.5', '99.6'), 'joints.d1: lower 99.6 mm is not below upper 99.5 mm'),
    ('four_dof', D1, D1.replace('79.5', '100'), 'joints.d1: home 100 mm; allowed 59.5 to 99.5 mm'),
    ('four_dof', D1, D1.replace('99.5', '120'), 'joints.d1.upper 120 mm; allowed below joints.d3.lower 119.5 mm (2.4)'),
    ('four_dof', D1, D1.replace('59.5', '10'), 'joints.d3.upper 159.5 mm; allowed below joints.d1.lower + 2 l2 = 150'),
    ('four_dof', 'dx: 10 mm', 'dx: 30 mm', 'least x1 - x2 in the travel is -9.78'),
    ('four_dof', 'dy: 10 mm', 'dy: 30 mm', 'least y2 - y1 in the travel is -9.78'),
    ('four_dof', 'k10: 116.6 mm', 'k10: 45 mm', 'r10 64.35 mm; allowed 0 to k10 45 mm'),
    ('planar', 'l2: 70 mm', 'l2: 49 mm', 'joints.d3.upper 159.5 mm; allowed below joints.d1.lower + 2 l2 = 157.5 mm'),
    ('planar', 'mechanism: planar', 'mechanism: delta', "mechanism: 'delta' given; known: ['four_dof', 'layout', "),
    ('planar', 'voltage_limit: 10 V', 'voltage_limit: -10 V', 'drive.voltage_limit'),
    ('xy_stage', 'my: 3.0 kg', 'my: 9.0 kg', 'my 9 kg; the X axis carries the Y axis: allowed 0 to mx 8.2 kg'),
]


@pytest.mark.parametrize(('name', 'old', 'new', 'reason'), REFUSED, ids=[entry[2] for entry in REFUSED])
def test_bad_value_is_refused_with_file_key_value_and_range(edited, name, old, new, reason):
    path = edited(name, old, new)
    with pytest.raises(ConfigError) as refused:
        load_machine(path)
    assert str(refused.value).startswith(str(path))
    assert reason in str(refused.value)


def test_rods_too_short_for_the_travel_are_refused(tmp_path):
    text = (FOLDER / 'four_dof.yaml').read_text()
    for key in ('k10', 'r10', 'r12'):
        text = re.sub(rf'\b{key}: [\d.]+ mm', f'{key}: 45 mm', text)
    path = tmp_path / 'short.yaml'
    path.write_text(text)
    # longest PQ in the travel: 70.5 mm on each axis, 99.7 mm
    with pytest.raises(ConfigError, match=r'largest PQ in the travel is 99\.7.* mm; allowed below 2 k10 = 90 mm'):
        load_machine(path)


def test_unknown_machine_is_refused_with_the_known_ones():
    with pytest.raises(ConfigError, match=r"'delta' is unknown; .* has \['four_dof', 'h_linkage', .*'xy_stage'\]"):
        load_machine('delta')
