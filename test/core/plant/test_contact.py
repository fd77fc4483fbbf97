"""Stops, collisions and the brake."""

import shutil
from itertools import product

import numpy as np
import pytest

from pkm_core.config import Configuration
from pkm_core.machines import load_machine
from pkm_core.plant.contact import contact_force
from pkm_core.plant.plant import Plant

MACHINES = ('four_dof', 'planar', 'xy_stage')


def play(plant, volts):
    for row in volts:
        plant.tick(row)


def test_contact_force_acts_in_contact_only_and_never_pulls():
    assert contact_force(-1e-6, 1.0, 1e6, 1.0) == 0.0
    assert contact_force(1e-3, 0.0, 1e6, 1.0) == 1000.0
    assert contact_force(1e-3, 0.5, 1e6, 1.0) == 1500.0
    assert contact_force(1e-3, -2.0, 1e6, 1.0) == 0.0


@pytest.mark.parametrize('signs', list(product((-1.0, 1.0), repeat=4)))
def test_full_voltage_into_a_stop_is_a_fault_with_finite_state(signs):
    """Every combination of signs of the voltages."""
    plant = Plant(load_machine('four_dof'), 1, 'nominal')
    play(plant, np.tile(10.0 * np.array(signs), (400, 1)))
    assert 'ran into its' in plant.fault
    truth = plant.truth
    assert np.isfinite(truth.pose).all()
    # 110 N, at up to 2 m/s on 1000 N/mm: below 2 mm beyond the stop, which is 1 mm beyond the travel
    limits = plant.machine.limits
    assert (truth.q > limits.lower - 3e-3).all()
    assert (truth.q < limits.upper + 3e-3).all()


def test_fault_names_joint_position_and_travel():
    plant = Plant(load_machine('planar'), 1, 'ideal')
    play(plant, np.tile([0.0, 3.0], (300, 1)))
    assert 'd3 ran into its upper stop at 16' in plant.fault
    assert 'travel is 119.50 to 159.50 mm' in plant.fault
    plant.reset()
    assert plant.fault is None


def test_carriages_that_touch_are_a_collision_fault(tmp_path):
    shutil.copytree(Configuration.of_environment().folder, tmp_path, dirs_exist_ok=True)
    path = tmp_path / 'truth' / 'four_dof.yaml'
    # longer than the gap of 20 mm between the stops
    path.write_text(path.read_text().replace('carriage_length: 15 mm', 'carriage_length: 40 mm'))
    plant = Plant(load_machine('four_dof', Configuration(tmp_path)), 1, 'ideal')
    play(plant, np.tile([2.0, -2.0, 0.0, 0.0], (300, 1)))
    assert 'carriages d1 at' in plant.fault
    assert 'collided' in plant.fault
    assert plant.truth.q[1] - plant.truth.q[0] > 39e-3


@pytest.mark.parametrize('name', MACHINES)
def test_brake_stops_the_moving_machine_without_commands(name):
    plant = Plant(load_machine(name), 1, 'nominal')
    play(plant, np.tile(np.where(np.arange(len(plant.machine.joints)) % 2, -1.5, 1.5), (40, 1)))
    speed = np.abs(plant.truth.qd).max()
    readings = list(plant.brake(400))
    assert len(readings) == 400
    assert np.abs(plant.truth.qd).max() < 1e-3 * speed  # four time constants of the heaviest; then friction catches it
    assert np.abs(plant.truth.current).max() < 1e-12
    assert plant.fault is None


def test_brake_force_follows_the_winding_time_constant():
    """Braking force of shorted phases, behind their lag L/R."""
    plant = Plant(load_machine('xy_stage'), 1, 'ideal')
    play(plant, np.vstack([np.tile([2.0, 0.0], (40, 1)), np.zeros((4, 2))]))
    next(iter(plant.brake(1)))
    early = plant.truth.thrust[0] / plant.truth.qd[0]
    list(plant.brake(9))
    late = plant.truth.thrust[0] / plant.truth.qd[0]
    # Kf^2 / (1.5 R) = 12.5^2 / (1.5 * 0.48) = 217 N s/m; L/R = 0.375 ms gives 1 - exp(-0.484/0.375) in one tick,
    # less the deceleration of the carriage: 217 N s/m on 8.2 kg is 26 /s, 1 % over the lag
    assert early == pytest.approx(-217.0 * (1.0 - np.exp(-0.484 / 0.375)), rel=0.02)
    assert late == pytest.approx(-217.0, rel=0.02)
