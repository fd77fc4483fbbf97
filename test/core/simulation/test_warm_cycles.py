"""Cycles of a machine that warms up: pauses, temperatures at power-up, what they change, determinism."""

import numpy as np
import pytest

from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles

PLANAR = load_machine('planar')
MOTION = load_motion(default_motion(PLANAR)).model_copy(update={'move_time': 30e-3})
JOINTS = to_joints(PLANAR, plan(PLANAR, MOTION))
GAINS = load_control(PLANAR)
CYCLE = len(JOINTS) * PLANAR.sample_time  # [s]


def run(cycles, environment='warm', **options):
    return run_cycles(PLANAR, JOINTS, GAINS, None, cycles, 1, environment, **options)


def temperatures(records, cycle=-1):
    return np.array(list(records.temperatures[cycle].values()))


def test_pause_warms_as_the_cycles_it_stands_for():
    """Losses differ by friction from cycle to cycle, and the first cycle from power-up by 1 %."""
    every, few = run(41), run(5, pauses=np.full(4, 9.0 * CYCLE))
    np.testing.assert_allclose(temperatures(few)[:2], temperatures(every)[:2], rtol=0.02)
    assert 0.1 < temperatures(every)[0] < 1.0


def test_temperatures_are_those_of_the_start_of_each_cycle():
    records = run(3)
    assert (temperatures(records, 0) == 0.0).all()
    assert (temperatures(records, 1)[:2] > 0.0).all()
    assert (temperatures(records, 2) > temperatures(records, 1)).all()
    assert run(2, 'nominal').temperatures == ({}, {})


def test_warm_motors_need_more_volts():
    """50 K: the force constant is 5 % lower."""
    cold, warm = run(2), run(2, rise=np.r_[50.0, 50.0, np.zeros(5)])
    peaks = [np.abs(records.voltage[1]).max(axis=0) for records in (cold, warm)]
    np.testing.assert_allclose(peaks[1] / peaks[0], 1.05, atol=0.015)


@pytest.mark.parametrize('pauses', [None, np.array([600.0, 60.0])])
def test_same_seed_and_pauses_give_the_same_bits(pauses):
    first, second = run(3, pauses=pauses, laser=True), run(3, pauses=pauses, laser=True)
    for records in zip(first.laser, second.laser, strict=True):
        np.testing.assert_array_equal(*(samples.displacement for samples in records))
    np.testing.assert_array_equal(first.truth, second.truth)
    np.testing.assert_array_equal(first.counts, second.counts)
    assert first.temperatures == second.temperatures


def test_pauses_change_nothing_without_heat():
    paused, plain = run(2, 'nominal', pauses=np.array([3600.0])), run(2, 'nominal')
    np.testing.assert_array_equal(paused.counts, plain.counts)


def test_temperatures_without_heat_are_refused():
    with pytest.raises(PkmError, match='no section heat'):
        run(1, 'nominal', rise=np.zeros(7))
