"""The monitor: what it notices and when, what it goes back to, and that it does so in the loop."""

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
def test_learning_that_converges_is_left_alone(course):
    for iteration, decision in enumerate(decisions(course)):
        assert decision.learn
        assert decision.message == ''
        assert decision.iteration == iteration
        assert (decision.feedforward == iteration).all()


def test_error_of_sign_is_noticed_within_two_cycles():
    seen = decisions([22, 45, 89])
    assert [decision.learn for decision in seen] == [True, True, False]
    assert (seen[-1].feedforward == 0).all()  # the best is before learning
    assert seen[-1].message == (
        'learning of d1 diverges: 22.0, 45.0, 89.0 um rms in the last cycles; '
        'back to the feedforward that left 22.0 um, and learning anew'
    )


def test_slow_divergence_is_noticed_in_the_second_cycle_above_three_times_the_level():
    course = [20, 6, 3, 2, 2, 2, *(2 * 1.25**k for k in range(1, 12))]
    seen = decisions(course)
    first = next(k for k, decision in enumerate(seen) if not decision.learn)
    assert course[first - 2] < 3 * 2 < course[first - 1]
    assert (seen[first].feedforward == 3).all()


def test_learning_begins_anew_after_going_back():
    seen = decisions([30, 5, 1, 1, 1, 1, 1, 41, 38, 41, 8, 2, 1])  # the machine has changed in cycle 7
    assert [k for k, decision in enumerate(seen) if not decision.learn] == [8]
    assert [decision.iteration for decision in seen[9:]] == [0, 1, 2, 3]
    assert all(decision.message == '' for decision in seen[9:])


def test_second_divergence_ends_learning_with_the_best_feedforward():
    seen = decisions([22, 45, 89, 22, 45, 89, 22, 22])
    assert [decision.learn for decision in seen] == [True, True, False, True, True, False, False, False]
    assert seen[5].message.endswith('where it stays, for this is the second time')
    for decision in seen[5:]:
        assert (decision.feedforward == 3).all()  # the one of the cycle that followed the first return
    assert seen[6].message == ''


@pytest.mark.parametrize('values', [(np.nan, 0.0), (0.0, np.inf)])
def test_what_is_not_finite_is_refused(values):
    with pytest.raises(LearningError, match='monitor d1: error or feedforward is not finite'):
        Monitor('d1').observe(np.full(4, values[0]), np.full(4, values[1]))


def test_best_is_not_changed_by_what_the_caller_does_with_his_array():
    monitor, feedforward = Monitor('d1'), np.ones(4)
    monitor.observe(np.full(4, UM), feedforward)
    feedforward[:] = 7.0
    assert (monitor.best == 1.0).all()


def test_law_with_wrong_sign_is_caught_in_the_loop():
    machine = load_machine('planar')
    trajectory, control = to_joints(machine, plan(machine, load_motion('planar_80ms'))), load_control(machine)
    law = untested_law('fourier_pid', machine, control)
    right = law.action
    law.action = lambda joint, frequency: -right(joint, frequency)
    records = run_cycles(machine, trajectory, control, law, 8, 1)
    assert len(records.notices) == 4  # going back and the end, of both joints
    assert records.notices[0].startswith('cycle 3: learning of d1 diverges')
    assert records.notices[-1].startswith('cycle 6: learning of d3 diverges')
    error = records.metric('max_dynamic_error')
    np.testing.assert_array_equal(records.feedforward[3], 0.0)
    assert (error[6:] < 1.5 * error[0]).all()


def test_thesis_law_without_its_advance_is_kept_from_diverging():
    machine = load_machine('four_dof')
    trajectory = to_joints(machine, plan(machine, load_motion('four_dof_70ms')))
    control = load_control(machine, 'four_dof_thesis')
    law = untested_law('fourier', machine, control).as_printed()
    records = run_cycles(machine, trajectory, control, law, 50, 1)
    error = records.metric('max_dynamic_error').max(axis=1) / UM
    assert error[5:8].max() < 6.0  # it looks converged; unwatched it is at 60 um by cycle 30 and at 1 mm by cycle 50
    assert error.max() == error[0]
    assert error[-1] < 6.0
    assert sum('the second time' in notice for notice in records.notices) == 4
