"""Machines with a calibrated geometry: forward by hand, inverse, Jacobian, motion, laser axes, refusals."""

import pickle

import numpy as np
import pytest
import yaml

from pkm_core.config import Config, Configuration, parse_config
from pkm_core.design.calibration import built_machine
from pkm_core.errors import ConfigError, WorkspaceError
from pkm_core.jet import Jet
from pkm_core.machines import load_machine
from pkm_core.machines.real_geometry import MODELS
from pkm_core.machines.uncertainty import Uncertainty

DRAWN = {name: load_machine(name) for name in ('four_dof', 'planar')}
both = pytest.mark.parametrize('name', DRAWN)
BOUNDS = {
    'scale': 1e-4,
    'laser': 5e-4,
    'square': 5e-4,
    'pitch': 5e-4,
    'roll': 5e-4,
    'height': 5e-5,
}  # the others: 10 um


def random_errors(name, share, seed=1):
    """Return lengths and marks of some 50 um, and every error of the geometry at `share` of its bound."""
    draw = np.random.default_rng(seed)
    machine = DRAWN[name]
    lengths = {key: 50e-6 * draw.standard_normal() for key in (*type(machine).Built.names(), *machine.joints)}
    signs = {key: draw.choice([-1.0, 1.0]) for key in MODELS[name].model_fields}
    return lengths | {key: share * sign * BOUNDS.get(key.split('_')[0], 1e-5) for key, sign in signs.items()}


def random_joints(machine, rows, seed=2):
    return np.random.default_rng(seed).uniform(machine.limits.lower, machine.limits.upper, (rows, len(machine.joints)))


@both
@pytest.mark.parametrize('share', [0.1, 1.0])
def test_inverse_of_real_geometry_is_exact(name, share):
    """To 1e-12 m even with every error at the bound of a machine file, far beyond real ones."""
    machine = built_machine(DRAWN[name], random_errors(name, share))
    q = random_joints(machine, 200)
    np.testing.assert_allclose(machine.inverse(machine.forward(q)), q, rtol=0.0, atol=1e-12)


@both
def test_motion_of_real_geometry_has_exact_derivatives(name):
    """Position, speed, acceleration and jerk of the joints return through forward and inverse."""
    machine = built_machine(DRAWN[name], random_errors(name, 0.2))
    rates = np.random.default_rng(3).standard_normal((3, 50, len(machine.joints)))
    jet = Jet.from_derivatives(random_joints(machine, 50), *rates)
    for back, wanted in zip(machine.inverse(machine.forward(jet)).derivatives(), jet.derivatives(), strict=True):
        # speeds of 1 m/s over gaps of 20 mm: jerks of 1e4 m/s^3 inside, of which 1e-8 is rounding
        np.testing.assert_allclose(back, wanted, rtol=0.0, atol=1e-8)


@both
def test_jacobian_of_real_geometry_is_the_derivative(name):
    machine = built_machine(DRAWN[name], random_errors(name, 1.0))
    q, h = random_joints(machine, 50), 1e-6
    steps = h * np.eye(len(machine.joints))
    differences = np.stack([(machine.forward(q + s) - machine.forward(q - s)) / (2.0 * h) for s in steps], axis=-1)
    np.testing.assert_allclose(machine.jacobian(q), differences, atol=1e-7)
    assert np.abs(machine.jacobian(q) - DRAWN[name].jacobian(q)).max() > 1e-4


@both
def test_machine_without_geometry_keeps_its_bits(name):
    """And one whose geometry is all zero agrees to rounding."""
    lengths = {key: error for key, error in random_errors(name, 0.0).items() if key not in MODELS[name].model_fields}
    plain, zero = built_machine(DRAWN[name], lengths), built_machine(DRAWN[name], random_errors(name, 0.0))
    assert plain.config.built.geometry is None
    assert zero.config.built.geometry is not None
    q = random_joints(plain, 50)
    np.testing.assert_allclose(zero.forward(q), plain.forward(q), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(zero.jacobian(q), plain.jacobian(q), atol=1e-11)
    np.testing.assert_array_equal(plain.laser_axes, np.eye(len(plain.coordinates)))


def test_errors_of_guides_move_the_end_point_by_hand():
    """Planar: a scale moves a slider in proportion; a bow of the guide lifts both pivots and so the joint."""
    planar = DRAWN['planar']
    longer = built_machine(planar, {'scale_d1': 1e-5, 'scale_d3': 1e-5})
    reading = planar.home
    np.testing.assert_allclose(longer.forward(reading), planar.forward(reading * (1.0 + 1e-5)), atol=1e-15)
    bent = built_machine(planar, {'x_side_2': 1e-6})
    ends = np.array([0.0595, 0.1595])  # both sliders at the ends of the guide, where the polynomial is 1
    np.testing.assert_allclose(bent.forward(ends) - planar.forward(ends), [0.0, 1e-6], atol=1e-12)


def test_turned_guide_of_four_dof_moves_q_alone():
    """Q is at (x2, y2) from the crossing; the end-effector is between P and Q. A common height raises it by half."""
    four = DRAWN['four_dof']
    x, y, z, phi = four.forward(four.home)
    half = np.hypot(x - 0.1095, y - 0.0732455532)  # P, worked example at home
    q = np.array([x - half * np.cos(phi), y - half * np.sin(phi)])
    turned = built_machine(four, {'square': 1e-6}).forward(four.home) - four.forward(four.home)
    moved = 1e-6 * np.array([-q[1], q[0]])
    along = np.array([np.cos(phi), np.sin(phi)]) @ -moved  # PQ becomes longer by this
    np.testing.assert_allclose(turned[:2], 0.5 * moved, atol=1e-12)
    assert turned[2] == pytest.approx(-0.5 * along * half / (z - 0.01), rel=1e-4)
    raised = built_machine(four, {'height': 1e-6}).forward(four.home) - four.forward(four.home)
    assert raised[2] == pytest.approx(0.5e-6, rel=1e-4)
    assert raised[3] == pytest.approx(0.0, abs=1e-12)


def test_laser_axes_of_a_machine_are_those_of_its_file():
    machine = built_machine(DRAWN['four_dof'], {'laser_xy': 1e-4, 'laser_zx': -2e-4})
    expected = np.eye(4)
    expected[0, 1], expected[2, 0] = 1e-4, -2e-4
    np.testing.assert_array_equal(machine.laser_axes, expected)
    q = random_joints(machine, 10)
    moved = machine.forward(q) - machine.forward(machine.home)
    read = machine.read_by_laser(q) - machine.read_by_laser(machine.home)
    np.testing.assert_allclose(read[:, 0] - moved[:, 0], 1e-4 * moved[:, 1], atol=1e-16)
    np.testing.assert_allclose(machine.from_laser(read), moved, atol=1e-15)
    again = pickle.loads(pickle.dumps(machine))  # workers of a study get machines
    np.testing.assert_array_equal(again.forward(again.home), machine.forward(machine.home))


@both
def test_real_geometry_out_of_reach_is_refused(name):
    machine = built_machine(DRAWN[name], random_errors(name, 0.1))
    apart = machine.home + np.linspace(-0.1, 0.1, len(machine.joints))
    for refused in (machine.forward, machine.jacobian):
        with pytest.raises(WorkspaceError, match='allowed'):
            refused(apart)
    with pytest.raises(WorkspaceError, match='allowed'):
        machine.inverse(machine.forward(machine.home) + 0.2)


@pytest.mark.parametrize(
    ('key', 'value', 'message'),
    [
        ('scale_d1', '200 ppm', r"built\.geometry\.scale_d1: '200 ppm' given"),
        ('square', '0.6 mrad', r"built\.geometry\.square: '0\.6 mrad' given"),
        ('x_side_2', '1 mm', r"built\.geometry\.x_side_2: '1 mm' given"),
        ('laser_xy', '1 um', r'built\.geometry\.laser_xy: .* dimension'),
        ('x_side_9', '1 um', r"unknown key 'built\.geometry\.x_side_9'"),
    ],
)
def test_wrong_geometry_of_a_file_is_refused_by_key(key, value, message, tmp_path):
    data = yaml.safe_load((Configuration.of_environment().folder / 'machines' / 'four_dof.yaml').read_text())
    lengths = dict.fromkeys(('l2', 'l4', 'l6', 'l8'), '70 mm') | {'k10': '116.6 mm', 'k12': '116.6 mm'}
    data['built'] = lengths | dict.fromkeys(('dx', 'dy', 'dz'), '10 mm')
    data['built'] |= {'marks': dict.fromkeys(('d1', 'd3', 'd5', 'd7'), '0 mm'), 'geometry': {key: value}}
    data['built']['specimen'] = {'machine': 'four_dof', 'origin': 'measured machine'}
    path = tmp_path / 'four_dof.yaml'
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError, match=message):
        load_machine(path)


@pytest.mark.parametrize(
    ('deviations', 'message'),
    [
        ({'l2': '1 um', 'square': '1 um'}, r'uncertainty\.deviations: square: .* dimension'),
        ({'l2': '1 ppm', 'scale_d1': '1 ppm'}, r'uncertainty\.deviations\.l2: .* dimension'),
        ({'l2': '1 um', 'scale_d1': '-1 ppm'}, r'uncertainty\.deviations: .*scale_d1 -1e-06 1 given; allowed from 0'),
        ({'l2': 1, 'scale_d1': '1 ppm'}, r'uncertainty\.deviations\.l2: .* no unit'),
    ],
)
def test_uncertainty_in_another_unit_is_refused_by_name(deviations, message):
    given = {'deviations': deviations, 'correlations': [[0.1]]}
    with pytest.raises(ConfigError, match=message):
        parse_config({'uncertainty': given}, _OnlyUncertainty, where='a test')
    right = {'deviations': {'l2': '1 um', 'scale_d1': '2 ppm', 'laser_xy': '3 urad'}, 'correlations': [[0.1], [0, 0]]}
    assert list(parse_config(right, Uncertainty, where='a test').deviations.values()) == pytest.approx(
        [1e-6, 2e-6, 3e-6]
    )


class _OnlyUncertainty(Config):
    uncertainty: Uncertainty
