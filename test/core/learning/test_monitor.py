"""The monitor: detection of divergence, the feedforward it returns to, and its effect in the loop."""

import numpy as np
import pytest

from pkm_core.control.robust import load_control
from pkm_core.errors import LearningError
from pkm_core.learning import untested_law
from pkm_core.learning.monitor import Monitor
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles

UM = 1e-6


def decisions(course):
    """Feed cycles with these errors [um rms] to a monitor; the feedforward of cycle k is k volts."""
    monitor = Monitor('d1')
    return [monitor.observe(np.full(4, error * UM), np.full(4, float(k))) for k, error in enumerate(course)]


@pytest.mark.parametrize(
    'course',
    [
        [28, 8, 5, 1.9, 1.1, 1.0, 0.9, 1.3, 0.8, 1.1],
        [10, 3.5, 1.2, 0.3, 0.9, 0.35, 1.7, 1.9, 0.3, 0.4],  # friction that does not repeat, 5 times the best cycle
        [0.2, 0.3, 0.5, 0.9, 1.5, 0.4],  # noise
        [5, 9, 4, 6, 3],  # one bad cycle
    ],
)
def test_converging_learning_is_not_interrupted(course):
    for iteration, decision in enumerate(decisions(course)):
        assert decision.learn
        assert decision.message == ''
        assert decision.iteration == iteration
        assert (decision.feedforward == iteration).all()


def test_wrong_sign_is_detected_within_two_cycles():
    seen = decisions([22, 45, 89])
    assert [decision.learn for decision in seen] == [True, True, False]
    assert (seen[-1].feedforward == 0).all()  # the best is before learning
    assert seen[-1].message == (
        'learning of d1 diverges: 22.0, 45.0, 89.0 um rms in the last cycles; '
        'returned to the feedforward with 22.0 um, learning restarts'
    )


def test_slow_divergence_is_detected_in_its_second_cycle():
    """Above three times the level."""
    course = [20, 6, 3, 2, 2, 2, *(2 * 1.25**k for k in range(1, 12))]
    seen = decisions(course)
    first = next(k for k, decision in enumerate(seen) if not decision.learn)
    assert course[first - 2] < 3 * 2 < course[first - 1]
    assert (seen[first].feedforward == 3).all()


def test_learning_restarts_from_the_best_feedforward():
    seen = decisions([30, 5, 1, 1, 1, 1, 1, 41, 38, 41, 8, 2, 1])  # the machine changes in cycle 7
    assert [k for k, decision in enumerate(seen) if not decision.learn] == [8]
    assert [decision.iteration for decision in seen[9:]] == [0, 1, 2, 3]
    assert all(decision.message == '' for decision in seen[9:])


def test_second_divergence_ends_learning_at_the_best_feedforward():
    seen = decisions([22, 45, 89, 22, 45, 89, 22, 22])
    assert [decision.learn for decision in seen] == [True, True, False, True, True, False, False, False]
    assert seen[5].message.endswith('learning ends after the second divergence')
    for decision in seen[5:]:
        assert (decision.feedforward == 3).all()  # the one of the cycle that followed the first return
    assert seen[6].message == ''


@pytest.mark.parametrize('values', [(np.nan, 0.0), (0.0, np.inf)])
def test_what_is_not_finite_is_refused(values):
    with pytest.raises(LearningError, match='monitor d1: error or feedforward is not finite'):
        Monitor('d1').observe(np.full(4, values[0]), np.full(4, values[1]))


def test_best_is_a_copy_of_the_caller_array():
    monitor, feedforward = Monitor('d1'), np.ones(4)
    monitor.observe(np.full(4, UM), feedforward)
    feedforward[:] = 7.0
    assert (monitor.best == 1.0).all()


def test_monitor_stops_a_law_with_wrong_sign_in_the_loop():
    machine = load_machine('planar')
    trajectory, gains = to_joints(machine, plan(machine, load_motion('planar_80ms'))), load_control(machine)
    law = untested_law('fourier_pid', machine, gains)
    right = law.action
    law.action = lambda joint, frequency: -right(joint, frequency)
    records = run_cycles(machine, trajectory, gains, law, 8, 1)
    assert len(records.notices) == 4  # return and end, for both joints
    assert records.notices[0].startswith('cycle 3: learning of d1 diverges')
    assert records.notices[-1].startswith('cycle 6: learning of d3 diverges')
    error = records.metric('max_dynamic_error')
    np.testing.assert_array_equal(records.feedforward[3], 0.0)
    assert (error[6:] < 1.5 * error[0]).all()


def test_monitor_stops_the_thesis_law_without_advance():
    machine = load_machine('four_dof')
    trajectory = to_joints(machine, plan(machine, load_motion('four_dof_70ms')))
    gains = load_control(machine, 'four_dof_thesis')
    law = untested_law('fourier', machine, gains).as_printed()
    records = run_cycles(machine, trajectory, gains, law, 50, 1)
    error = records.metric('max_dynamic_error').max(axis=1) / UM
    assert (
        error[5:8].max() < 6.0
    )  # it seems converged; without a monitor it reaches 60 um at cycle 30 and 1 mm at cycle 50
    assert error.max() == error[0]
    assert error[-1] < 6.0
    assert sum('second divergence' in notice for notice in records.notices) == 4


def test_saturated_feedforward_is_reported_once():
    monitor, given = Monitor('d1', limit=10.0), np.array([0.0, 9.9, -10.0, 10.0])
    messages = [monitor.observe(np.full(4, UM), each).message for each in (0.5 * given, given, given)]
    assert messages[0] == messages[2] == ''
    assert messages[1].startswith('d1: the learned feedforward is at the limit of the drive, 10 V, in 2 of 4 samples')


def test_simulation_reports_a_saturated_feedforward():
    """A drive limit below what the motion needs: the law clips the feedforward."""
    machine = load_machine('planar')
    weak = machine.config.model_copy(update={'drive': machine.config.drive.model_copy(update={'voltage_limit': 0.3})})
    machine = type(machine)(weak, machine.name, machine.configuration)
    joints, gains = to_joints(machine, plan(machine, load_motion('planar_80ms'))), load_control(machine)
    ran = run_cycles(machine, joints, gains, untested_law('fourier_pid', machine, gains), cycles=3, seed=1)
    assert any('at the limit of the drive, 0.3 V' in notice for notice in ran.notices)
