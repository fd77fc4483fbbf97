"""The monitor: detection of divergence, the feedforward it returns to, and its effect in the loop."""

import numpy as np
import pytest

from pkm_core.control.robust import load_control
from pkm_core.errors import LearningError
from pkm_core.learning import untested_law
from pkm_core.learning.monitor import LEARNED, PAUSE, Monitor
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


def test_changed_machine_keeps_the_feedforward_and_restarts():
    """Another thrust: the error rises at once and stays. The best feedforward is that of the old thrust."""
    seen = decisions([30, 5, 1, 1, 1, 1, 1, 29, 26, 2.4, 0.8, 0.9])
    assert all(decision.learn for decision in seen)
    assert [decision.iteration for decision in seen[7:]] == [7, 0, 1, 2, 3]
    assert (seen[8].feedforward == 8).all()
    assert [k for k, decision in enumerate(seen) if decision.message] == [8]
    assert seen[8].message.startswith('d1: the error rose to 1.0, 29.0, 26.0 um rms and stays; the machine has changed')


def test_second_divergence_pauses_learning_and_restarts_it():
    seen = decisions([22, 45, 89, 22, 45, 89, *[22] * PAUSE, 22, 5, 2])
    assert [k for k, decision in enumerate(seen) if not decision.learn] == [2, *range(5, 6 + PAUSE)]
    assert seen[5].message.endswith(f'learning pauses for {PAUSE} cycles')
    for decision in seen[5 : 6 + PAUSE]:
        assert (decision.feedforward == 3).all()  # the one of the cycle that followed the first return
    assert [decision.iteration for decision in seen[-3:]] == [0, 1, 2]


@pytest.mark.parametrize('growth', [1.1, 1.25])
def test_slow_rise_far_below_the_first_error_is_detected(growth):
    """By cycle 15; the first error is 7.5 um, so three times the level is reached late or never."""
    seen = decisions([7.5, 2.1, 1.6, *(0.3 * growth**k for k in range(12))])
    back = [decision for decision in seen if not decision.learn]
    assert len(back) == 1
    assert (back[0].feedforward == 3).all()
    assert back[0].iteration == LEARNED


def test_scatter_of_a_worn_machine_is_no_divergence():
    """Errors [um rms] of planar d1 and d3 in `hard`, seeds 1 and 2, resampled for 5400 cycles."""
    errors = [1.85, 1.29, 1.27, 0.88, 0.56, 0.77, 0.71, 1.47, 0.72, 0.44, 0.99, 1.44, 1.75, 1.26, 0.52, 1.02, 1.67,
              0.83, 1.25, 0.6, 1.08, 0.78, 1.18, 0.62, 1.24, 0.95, 1.65, 0.58, 0.94, 1.17, 0.59, 2.2]  # fmt: skip
    draw = np.random.default_rng(1)
    runs = [decisions([9, 3.3, 1.8, *draw.choice(errors, 57)]) for _ in range(90)]
    alarms = sum(bool(decision.message) for run in runs for decision in run)
    assert alarms <= 2
    assert all(run[-1].learn for run in runs)


def test_feedforward_from_a_file_has_had_updates():
    monitor = Monitor('d1', LEARNED)
    iterations = [monitor.observe(np.full(4, UM), np.zeros(4)).iteration for _ in range(3)]
    assert iterations == [LEARNED, LEARNED + 1, LEARNED + 2]


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
    assert len(records.notices) == 4  # return and pause, for both joints
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
    assert error[8:].max() < 15.0  # each restart is noticed after some cycles
    assert np.median(error[8:]) < 6.0
    assert sum('learning pauses' in notice for notice in records.notices) >= 4  # each joint
