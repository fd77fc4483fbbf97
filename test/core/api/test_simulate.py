"""The simulation of the public face: the bits of `run_cycles`, own controllers and laws, refusals."""

import numpy as np
import pytest

import pkm_core as pkm
from pkm_core.control.controllers import choose_control, make_controller
from pkm_core.learning import make_law
from pkm_core.simulation.cycles import run_cycles


@pytest.fixture(scope='module')
def machine():
    return pkm.load_machine('planar')


@pytest.fixture(scope='module')
def motion(machine):
    return pkm.plan(machine, 'planar_80ms')


@pytest.fixture(scope='module')
def learned(machine, motion):
    return pkm.simulate(machine, motion, cycles=3, law='fourier_pid', seed=7, laser=True)


class Proportional:
    """An own controller; notes what it is called with."""

    def __init__(self, gain=4000.0):
        self.gain, self.cycles, self.indices = gain, [], []

    def load(self, trajectory, learned):
        self.reference = trajectory.position
        self.cycles.append(learned)

    def update(self, index, measured):
        self.indices.append(index)
        return self.gain * (self.reference[index] - measured)


class Ahead:
    """An own law; notes what it is called with."""

    def __init__(self):
        self.calls = []

    def update(self, joint, error, feedforward, iteration, sample_time):
        self.calls.append((joint, iteration, error.copy()))
        return feedforward + 1000.0 * np.roll(error, -round(5e-3 / sample_time))


def test_simulation_has_the_bits_of_the_cell(machine, motion, learned):
    gains = choose_control(machine)
    law = make_law('fourier_pid', machine, gains)
    expected = run_cycles(machine, motion.joints, gains, law, 3, 7, laser=True)
    for name in ('error', 'counts', 'voltage', 'feedforward'):
        np.testing.assert_array_equal(getattr(learned.records, name), getattr(expected, name))
    assert (learned.controller, learned.law, learned.joints) == ('robust', 'fourier_pid', machine.joints)


def test_computed_torque_is_chosen_by_name(machine, motion):
    expected = run_cycles(machine, motion.joints, choose_control(machine, 'computed_torque'), None, 1, 1)
    result = pkm.simulate(machine, motion, controller='computed_torque')
    np.testing.assert_array_equal(result.error, expected.error)


def test_gains_may_be_given_in_any_order(machine, motion):
    gains = dict(reversed(choose_control(machine).items()))
    result, expected = (pkm.simulate(machine, motion, controller=each) for each in (gains, 'robust'))
    np.testing.assert_array_equal(result.error, expected.error)


def test_cycle_holds_the_signals_of_its_number(machine, learned):
    cycle = learned.cycle(2)
    np.testing.assert_array_equal(cycle.error, learned.error[1])
    np.testing.assert_array_equal(cycle.position, learned.records.counts[1] * machine.encoder_resolution)
    assert [each.max_dynamic_error for each in cycle.metrics().values()] == learned.max_dynamic_error[1].tolist()
    assert (cycle.number, cycle.law, cycle.is_whole) == (2, 'fourier_pid', True)
    assert 0 <= cycle.laser_time[0] < cycle.laser_time[-1] <= learned.motion.duration
    assert cycle.laser.shape == (len(cycle.laser_time), len(machine.coordinates))


@pytest.mark.parametrize('number', [0, 4, 1.5])
def test_cycle_that_was_not_driven_is_refused(learned, number):
    with pytest.raises(pkm.PkmError, match=r'^cycle: '):
        learned.cycle(number)


def test_own_controller_drives_the_machine(machine, motion):
    own = Proportional()
    result = pkm.simulate(machine, motion, cycles=2, controller=own)
    assert own.indices == [*range(len(motion))] * 2
    assert result.controller == 'Proportional'
    asked = np.clip(4000.0 * result.cycle(1).error, -machine.voltage_limit, machine.voltage_limit)
    np.testing.assert_array_equal(result.cycle(1).voltage, asked)
    assert not np.array_equal(result.error, pkm.simulate(machine, motion, cycles=2).error)


def test_own_controller_that_copies_ours_has_its_bits(machine, motion):
    """What lies between an own controller and the plant changes nothing."""

    class Ours:
        def __init__(self):
            self.inner = make_controller(machine, choose_control(machine))

        def load(self, trajectory, learned):
            self.inner.load(trajectory, learned)

        def update(self, index, measured):
            return self.inner.update(index, measured)[0]

    own, ours = (pkm.simulate(machine, motion, cycles=2, controller=each) for each in (Ours(), 'robust'))
    for name in ('error', 'counts', 'voltage'):
        np.testing.assert_array_equal(getattr(own.records, name), getattr(ours.records, name))


def test_own_voltage_is_limited_to_the_drive(machine, motion):
    result = pkm.simulate(machine, motion, controller=Proportional(gain=2e5))
    assert np.abs(result.cycle(1).voltage).max() == machine.voltage_limit


def test_own_law_is_called_and_changes_the_result(machine, motion):
    own = Ahead()
    result = pkm.simulate(machine, motion, cycles=3, law=own)
    assert [(joint, iteration) for joint, iteration, _ in own.calls] == [('d1', 0), ('d3', 0), ('d1', 1), ('d3', 1)]
    np.testing.assert_array_equal(own.calls[0][2], result.error[0, :, 0])
    np.testing.assert_array_equal(result.records.feedforward[1, :, 0], 1000.0 * np.roll(result.error[0, :, 0], -10))
    assert (result.max_dynamic_error[2] < result.max_dynamic_error[0]).all()


def test_law_object_of_the_project_has_its_bits(machine, motion, learned):
    law = make_law('fourier_pid', machine, choose_control(machine))
    result = pkm.simulate(machine, motion, cycles=3, law=law, seed=7)
    np.testing.assert_array_equal(result.error, learned.error)


def test_own_law_is_bound_to_the_motion(machine, motion):
    class Bound(Ahead):
        trajectory = None

        def with_reference(self, trajectory):
            bound.trajectory = trajectory
            return bound

    bound = Bound()
    pkm.simulate(machine, motion, cycles=2, law=Bound())
    assert bound.trajectory is motion.joints
    assert len(bound.calls) == 2


def test_own_law_works_with_an_own_controller(machine, motion):
    own, controller = Ahead(), Proportional()
    pkm.simulate(machine, motion, cycles=2, controller=controller, law=own)
    assert controller.cycles[1].any()
    assert not controller.cycles[0].any()


def test_first_cycle_starts_with_a_given_feedforward(machine, motion, learned):
    start = learned.records.feedforward[2]
    result = pkm.simulate(machine, motion, seed=7, initial_feedforward=start)
    assert (result.max_dynamic_error[0] < learned.max_dynamic_error[0]).all()


def with_update(function, base=Proportional):
    return type('Own', (base,), {'update': function})()


@pytest.mark.parametrize(
    ('options', 'error', 'text'),
    [
        ({'cycles': 0}, pkm.PkmError, 'simulate: cycles: 0 given; allowed from 1'),
        ({'cycles': 2.5}, pkm.PkmError, 'simulate: cycles: 2.5 given; expected a whole number from 1'),
        ({'seed': -1}, pkm.PkmError, 'simulate: seed: -1 given; allowed from 0'),
        ({'environment': 'mars'}, pkm.ConfigError, "environment 'mars' is unknown"),
        ({'law': 'foo'}, pkm.LearningError, "learning law 'foo' is unknown"),
        ({'law': Ahead}, pkm.LearningError, 'simulate: law is the class Ahead, not an object of it; allowed: '),
        ({'law': {'gain': 1.0}}, pkm.LearningError, "simulate: law is {'gain': 1.0}; allowed: "),
        (
            {'law': 'inverse', 'controller': 'computed_torque'},
            pkm.LearningError,
            'only controllers of single axes learn',
        ),
        ({'law': 'inverse', 'controller': Proportional()}, pkm.LearningError, "law 'inverse' is designed for gains"),
        ({'controller': 'foo'}, pkm.ConfigError, "control: 'foo' given; allowed: "),
        ({'controller': Proportional}, pkm.PkmError, 'simulate: controller is the class Proportional, not an object'),
        ({'controller': {'d1': 0}}, pkm.PkmError, r"controller has gains of ['d1']; expected ['d1', 'd3']"),
        (
            {'controller': with_update(lambda self, index, measured: [0.0])},
            pkm.PkmError,
            'controller Own: voltage of sample 0: shape (1,) given; expected (2,)',
        ),
        (
            {'controller': with_update(lambda self, index, measured: [0.0, np.nan if index == 5 else 0.0])},
            pkm.PkmError,
            'controller Own: voltage of sample 5: nan at [1]; expected finite numbers',
        ),
        (
            {'controller': with_update(lambda self, index, measured: None)},
            pkm.PkmError,
            'controller Own: voltage of sample 0: ',
        ),
        (
            {'cycles': 2, 'law': with_update(lambda self, joint, error, *rest: error[:5], Ahead)},
            pkm.LearningError,
            'law Own: feedforward of d1 after update 0: shape (5,) given; expected (',
        ),
        (
            {'cycles': 2, 'law': with_update(lambda self, joint, error, *rest: np.full_like(error, np.inf), Ahead)},
            pkm.LearningError,
            'law Own: feedforward of d1 after update 0: inf at [0]; expected finite numbers',
        ),
        (
            {'initial_feedforward': np.zeros(3)},
            pkm.PkmError,
            'simulate: initial_feedforward: shape (3,) given; expected',
        ),
    ],
)
def test_refusal_names_what_came(machine, motion, options, error, text):
    with pytest.raises(error) as refused:
        pkm.simulate(machine, motion, **options)
    assert text in str(refused.value)


def test_motion_of_another_machine_is_refused(motion):
    with pytest.raises(pkm.TrajectoryError, match='motion is for planar; the machine is xy_stage'):
        pkm.simulate(pkm.load_machine('xy_stage'), motion)
