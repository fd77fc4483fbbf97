"""The platform's spring: its response, its settled position, and that only the laser measures it."""

import numpy as np
import pytest

from pkm_core.control.model import load_model
from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine
from pkm_core.plant.changed_truth import changed_machine
from pkm_core.plant.laser import Laser
from pkm_core.plant.plant import Plant
from pkm_core.plant.platform import Platform
from pkm_core.plant.truth import load_truth, platform_modes

TICK = 0.5e-3
GIVEN = load_truth(load_machine('four_dof'), 'nominal')[0].platform


def test_constant_acceleration_deflects_a_damped_spring():
    off, rate = Platform([GIVEN], TICK).follow(4.0 * TICK * np.arange(800)[:, np.newaxis])
    w, z = 2.0 * np.pi * GIVEN.resonance, GIVEN.damping
    t, wd = TICK * np.arange(800), w * np.sqrt(1.0 - z * z)
    rest = -4.0 / w**2
    exact = rest * (1.0 - np.exp(-z * w * t) * (np.cos(wd * t) + z * w / wd * np.sin(wd * t)))
    np.testing.assert_allclose(off[:, 0], exact, atol=1e-12 * abs(rest) * len(t))
    np.testing.assert_allclose(rate[:, 0], -4.0 / wd * np.exp(-z * w * t) * np.sin(wd * t), atol=1e-12)
    assert off[-1, 0] == pytest.approx(-0.5e-6, rel=0.01)


def test_result_does_not_depend_on_the_length_of_calls():
    velocity = np.cumsum(np.random.default_rng(1).normal(0.0, 1e-3, (100, 3)), axis=0)
    whole, pieces = Platform([GIVEN] * 3, TICK), Platform([GIVEN] * 3, TICK)
    off, _ = whole.follow(velocity)
    joined = [pieces.follow(velocity[first : first + 12])[0][1:] for first in range(0, 99, 11)]
    np.testing.assert_array_equal(np.concatenate(joined), off[1:])


def test_laser_measures_the_platform_lag_under_acceleration():
    def off(environment):
        """Return (what the laser has seen beside joints and links, their acceleration) at ticks where both look."""
        plant = Plant(load_machine('xy_stage'), 1, environment)
        laser, path = Laser(plant.machine, 1, environment), [plant.truth.pose]
        laser.zero(0, plant.truth)
        for tick in range(1, 101):
            plant.tick([2.0, 0.0])
            laser.observe(tick, plant.truth)
            path.append(plant.truth.pose)
        acceleration = np.diff(path, 2, axis=0) / TICK**2
        at = np.arange(24, 100, 8)  # every 4 ms, when the first swing has lost a half
        return laser.read().displacement[at * 5 // 8] - (path - path[0])[at], acceleration[at].mean(axis=0)

    seen, acceleration = off('nominal')
    assert acceleration[0] > 7.0
    # 10 samples of rounding to 0.91 um, and the rest of the swing
    np.testing.assert_allclose(seen.mean(axis=0), -acceleration / (2.0 * np.pi * GIVEN.resonance) ** 2, atol=0.25e-6)
    stiff, _ = off('ideal')
    assert np.abs(stiff).max() < 0.46e-6


def readings(machine):
    """Return what the laser reads of 40 ticks of 4-DOF motion in `elastic`."""
    plant = Plant(machine, 1, 'elastic')
    laser = Laser(plant.machine, 1, 'elastic')
    laser.zero(0, plant.truth)
    for tick in range(1, 41):
        plant.tick([3.0, 1.0, -1.0, 2.0])
        laser.observe(tick, plant.truth)
    return laser.read().displacement


def test_equal_modes_by_direction_are_the_bits_of_a_scalar():
    machine, one = load_machine('four_dof'), {'resonance': '450 Hz', 'damping': '0.02'}

    def scalar(truth):
        del truth['environments']['elastic']['platform']

    def equal(truth):
        truth['environments']['elastic']['platform'] = dict.fromkeys(machine.coordinates, one)

    with changed_machine(machine, 'elastic', scalar) as first, changed_machine(machine, 'elastic', equal) as second:
        np.testing.assert_array_equal(readings(first), readings(second))
        assert (readings(first) != readings(machine)).any()


def test_each_coordinate_swings_with_its_own_mode():
    """In `elastic` the settled deflection under 4 m/s^2 is that of the mode of the coordinate."""
    machine = load_machine('four_dof')
    modes = platform_modes(machine, *load_truth(machine, 'elastic'))
    off, _ = Platform(modes, TICK).follow(4.0 * TICK * np.arange(4000)[:, np.newaxis] * np.ones(4))
    np.testing.assert_allclose(off[-1], [-4.0 / (2.0 * np.pi * mode.resonance) ** 2 for mode in modes], rtol=1e-6)
    assert len({mode.resonance for mode in modes}) == 4


def test_modes_by_direction_follow_from_the_linkage():
    """The values of config/truth are those of the formula in platform.py, rounded."""
    machine = load_machine('four_dof')
    models = [load_model(machine)[joint] for joint in machine.joints]
    w = 2.0 * np.pi * np.array([model.modes[1].resonance for model in models])
    z = np.array([model.modes[1].resonance_damping for model in models])
    carried = dict(zip(machine.parameters, machine.dynamic_parameters(), strict=True)) | dict.fromkeys(
        ('m1', 'm3', 'm5', 'm7'), 0.0
    )
    M = np.zeros((4, 4))
    machine.terms(machine.home, np.zeros(4), np.array(list(carried.values())), M, np.zeros(4), np.zeros(4))
    m, J = np.diag(M), machine.jacobian(machine.home)
    static = np.diag(J @ np.diag(1.0 / (m * w**2)) @ M @ np.linalg.inv(J))
    lag = np.diag(J @ np.diag(2.0 * z / w) @ np.linalg.inv(J))
    modes = platform_modes(machine, *load_truth(machine, 'elastic'))
    np.testing.assert_allclose([mode.resonance for mode in modes], static**-0.5 / (2.0 * np.pi), atol=0.5)
    np.testing.assert_allclose([mode.damping for mode in modes], 0.5 * lag * static**-0.5, atol=0.0005)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda modes: modes.pop('phi'), r"elastic.platform: \['x', 'y', 'z'\] given; allowed: one mode for each of"),
        (lambda modes: modes.update(w=modes['x']), r"'w'\] given; allowed: one mode for each of"),
        (lambda modes: modes['y'].update(resonance='0 Hz'), r"platform.y.resonance: '0 Hz' given; allowed > 0"),
        (
            lambda modes: modes['y'].update(resonance='380'),
            "platform.y.resonance: '380' has the dimension of dimension",
        ),
        (lambda modes: modes['z'].update(damping='1.0'), r'platform.z.damping: .* given; allowed < 1'),
        (lambda modes: modes['z'].update(stiffness='1 N/m'), "unknown key 'environments.elastic.platform.z.stiffness'"),
    ],
)
def test_wrong_modes_by_direction_are_refused(change, message):
    def changed(truth):
        change(truth['environments']['elastic']['platform'])

    machine = load_machine('four_dof')
    with changed_machine(machine, 'elastic', changed) as wrong, pytest.raises(ConfigError, match=message):
        load_truth(wrong, 'elastic')
