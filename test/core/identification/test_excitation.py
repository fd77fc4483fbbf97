"""Identification experiments: smooth, within travel, force and speed; refused beforehand or stopped by the guard."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.identification import IdentificationError
from pkm_core.identification.excitation import slow_moves, sweeps
from pkm_core.identification.guard import Bounds, Guard
from pkm_core.identification.sweep import Sweep, forecast, one_period
from pkm_core.machines import load_machine
from pkm_core.simulation.experiment import SimulatedCell

NAMES = ('planar', 'four_dof', 'xy_stage')
BOUNDS = Bounds(lower=0.06, upper=0.1, voltage=2.0, speed=0.1)


@cache
def parts(name):
    machine = load_machine(name)
    return machine, load_model(machine), load_control(machine)


def moves_of(name, joint):
    machine, models, _ = parts(name)
    return slow_moves(machine, joint, models[joint])


def sweeps_of(name, joint, **settings):
    machine, models, gains = parts(name)
    return sweeps(machine, joint, models[joint], gains[joint], Sweep(**settings))


def all_experiments(name):
    for joint in parts(name)[0].joints:
        yield joint, moves_of(name, joint)
        for experiment in sweeps_of(name, joint):
            yield joint, experiment


@pytest.mark.parametrize('name', NAMES)
def test_experiments_start_and_end_at_rest_at_home(name):
    home = parts(name)[0].home
    for _, experiment in all_experiments(name):
        path = experiment.trajectory
        for end in (0, -1):
            np.testing.assert_allclose(path.position[end], home, atol=1e-12)
            for rate in (path.velocity, path.acceleration, path.jerk):
                assert not rate[end].any()
        assert not experiment.excitation[[0, -1]].any()


@pytest.mark.parametrize('name', NAMES)
def test_trajectory_rates_are_the_derivatives_of_its_position(name):
    for _, experiment in all_experiments(name):
        path = experiment.trajectory
        for values, rate in (
            (path.position, path.velocity),
            (path.velocity, path.acceleration),
            (path.acceleration, path.jerk),
        ):
            slope = np.gradient(values, path.sample_time, axis=0)[1:-1]
            # where p7 begins its jerk has a kink: central differences then err by 3 % of the peak
            np.testing.assert_allclose(slope, rate[1:-1], atol=4e-2 * np.abs(rate).max())


def test_slow_moves_of_the_thesis_cover_the_travel():
    """Lengths and durations of 7.3.2 and 8.3.2, there and back, over 90 % of the travel."""
    length = {
        'planar': {'d1': (10, 70), 'd3': (10, 80)},
        'four_dof': {'d1': (5, 70), 'd3': (5, 70), 'd5': (4, 70), 'd7': (4, 70)},
    }
    for name, joints in length.items():
        machine = parts(name)[0]
        for joint, (millimetres, milliseconds) in joints.items():
            axis, path = machine.joints.index(joint), moves_of(name, joint).trajectory
            steps = path.position[path.move_ends] - path.position[path.move_starts]
            np.testing.assert_allclose(np.abs(steps[:, axis]), 1e-3 * millimetres)
            assert not np.delete(steps, axis, axis=1).any()
            assert (path.move_ends - path.move_starts == 2 * milliseconds).all()
            assert steps[:, axis].sum() == pytest.approx(0)
            covered = path.position[:, axis]
            assert np.ptp(covered) > 0.9 * (machine.limits.upper - machine.limits.lower)[axis]


def test_only_the_joint_itself_jogs_and_is_excited():
    machine, _, _ = parts('four_dof')
    for experiment in sweeps_of('four_dof', 'd3'):
        excited = experiment.excitation.any(axis=1)
        speeds = experiment.trajectory.velocity[excited]
        assert np.abs(speeds[:, machine.joints.index('d3')]) == pytest.approx(15e-3)
        assert not np.delete(speeds, machine.joints.index('d3'), axis=1).any()
        assert not np.delete(experiment.excitation, machine.joints.index('d3'), axis=1).any()


def test_sweep_spans_its_band_in_whole_periods():
    experiment = sweeps_of('planar', 'd1')[0]
    volts = experiment.excitation[:, 0]
    begin = np.flatnonzero(volts)[0] - 1
    np.testing.assert_array_equal(volts[begin : begin + 1024], volts[begin + 1024 : begin + 2048])
    power = np.abs(np.fft.rfft(volts[begin : begin + 1024])) ** 2
    frequency = np.fft.rfftfreq(1024, 0.5e-3)
    assert (
        power[(frequency >= 79) & (frequency <= 501)].sum() > 0.97 * power.sum()
    )  # the rest is the step back from 500 to 80 Hz


@pytest.mark.parametrize(
    ('settings', 'reason'),
    [
        ({'band': (80.0, 1000.0)}, r'80 to 1000 Hz; expected .* < 1000 Hz, half the sampling rate'),
        ({'band': (500.0, 80.0)}, r'500 to 80 Hz; expected 0 < from < to'),
        ({'band': (80.0, 85.0)}, r'has 2\.6 lines; at least 10'),
        ({'periods': 1}, r'1 period per pass; at least 2'),
        ({'periods': 6}, r'd1: a stroke of 48\.8 mm leaves the travel; allowed 39\.0 mm, 0\.5 mm off either end'),
        ({'speed': 60e-3}, r'd1: a stroke of 102\.8 mm leaves the travel; allowed 39\.0 mm'),
    ],
)
def test_infeasible_sweep_is_refused_with_numbers(settings, reason):
    with pytest.raises(IdentificationError, match=reason):
        sweeps_of('planar', 'd1', **settings)


def test_moves_beyond_the_drive_are_refused():
    """The message holds voltage and force, both with their limits."""
    machine, models, _ = parts('planar')
    weak = models['d1'].model_copy(update={'gain': models['d1'].gain / 15})  # model of an axis 15 times as heavy
    with pytest.raises(IdentificationError, match=r'd1 would need \d+\.\d V \(\d+ N\); allowed 10 V \(110 N\)'):
        slow_moves(machine, 'd1', weak)


def test_unknown_joint_is_refused():
    machine, models, _ = parts('planar')
    with pytest.raises(IdentificationError, match=r"'d5' is unknown; planar has \['d1', 'd3'\]"):
        slow_moves(machine, 'd5', models['d1'])


@pytest.mark.parametrize(
    ('voltage', 'position', 'reference', 'reason'),
    [
        (0.0, 0.08, 0.08, ''),
        (0.0, 0.0599, 0.0595, 'sample 20: d1 is at 59.900 mm; allowed 60 to 100 mm'),
        (0.0, 0.08, 0.0815, 'sample 20: d1 is -1.500 mm off its reference; allowed 1 mm'),
        (0.0, 0.0806, 0.0806, 'sample 20: d1 moves at 0.150 m/s; allowed 0.100 m/s'),
        (-2.5, 0.08, 0.08, 'sample 20: d1 gets -2.50 V; allowed 2.00 V'),
        (0.0, np.nan, 0.08, 'sample 20: d1 is at nan mm; allowed 60 to 100 mm'),
    ],
)
def test_guard_returns_value_and_bound(voltage, position, reference, reason):
    guard = Guard('d1', BOUNDS, 0.5e-3)
    for index in range(20):
        assert guard.check(index, 0.0, 0.08, 0.08) == ''
    assert guard.check(20, voltage, position, reference) == reason


@pytest.mark.parametrize('name', NAMES)
def test_machine_stays_within_the_forecast_bounds(name):
    machine, _, gains = parts(name)
    cell = SimulatedCell(machine, gains, 1)
    for joint in machine.joints:
        for experiment in (moves_of(name, joint), sweeps_of(name, joint)[0]):
            record = cell.run(experiment)  # raises if a bound is exceeded
            peak = np.abs(record.voltage[:, machine.joints.index(joint)]).max()
            assert peak < 0.9 * experiment.bounds.voltage


def test_abort_leaves_the_machine_at_rest_and_ready():
    machine, _, gains = parts('planar')
    cell = SimulatedCell(machine, gains, 1)
    experiment = moves_of('planar', 'd1')
    strict = replace(experiment, bounds=replace(experiment.bounds, speed=0.05))
    with pytest.raises(IdentificationError, match=r'd1_slow_moves: sample \d+: d1 moves at .* braked to a standstill'):
        cell.run(strict)
    assert np.abs(cell._plant.truth.qd).max() < 1e-4  # m/s


def test_vibration_stays_slower_than_the_jog():
    """For any requested share of the jog speed the slider never stops."""
    machine, models, gains = parts('planar')
    one = {}
    for shake in (0.6, 1.0):
        wish = Sweep(band=(20.0, 500.0), shake=shake)
        volts = one_period(wish, models['d1'], gains['d1'], machine.sample_time, 10.0)
        one[shake] = np.abs(forecast(models['d1'], gains['d1'], volts, machine.sample_time)[1]).max() / wish.speed
    assert 0.5 < one[0.6] <= 0.9 * (1 + 1e-9)
    assert one[1.0] == pytest.approx(0.9)
