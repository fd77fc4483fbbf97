"""Tolerances of a joint trajectory: what they mean, and what is refused."""

from math import inf, nan

import numpy as np
import pytest

from pkm_core.errors import FollowError
from pkm_core.motion.tolerances import JointTolerance, check_start, tolerances_of

JOINTS = ('d1', 'd3')
UM = 1e-6
STEP = 5e-4
START, END = 4, 10  # samples of a cycle of 20


def cycle(**spikes):
    """Return errors (20, 2) of 1 um with spikes `d3_at_7=9.0` [um]."""
    errors = np.full((20, 2), 1 * UM)
    for key, value in spikes.items():
        joint, sample = key.split('_at_')
        errors[int(sample), JOINTS.index(joint)] = value * UM
    return errors


def check(errors, *, path=(), goal=(), goal_time=0.0):
    tolerances_of(JOINTS, path, goal, goal_time).check_cycle(errors, START, END, STEP)


def refused(*arguments, **options):
    """Return (code, text) of the refusal of `tolerances_of` or `check`."""
    function = check if arguments else lambda **given: tolerances_of(JOINTS, **given)
    with pytest.raises(FollowError) as refusal:
        function(*arguments, **options)
    return refusal.value.code, str(refusal.value)


def test_no_tolerance_bounds_nothing():
    """0 is the default, which is none; -1 erases it; a joint without an entry has none."""
    for value in (0.0, -1.0, -1.00000005):
        tolerances = tolerances_of(JOINTS, [JointTolerance('d1', value)], [JointTolerance('d1', value)], value)
        assert tolerances.bounded == []
        assert tolerances.goal_time == inf
        tolerances.check_cycle(np.full((20, 2), nan), START, END, STEP)
    assert tolerances_of(JOINTS, [JointTolerance('d3', UM)]).bounded == ['d3']


def test_path_tolerance_names_joint_time_and_error():
    path = [JointTolerance('d1', 20 * UM), JointTolerance('d3', 5 * UM)]
    check(cycle(d1_at_7=19.9, d3_at_7=-5.0), path=path)
    assert refused(cycle(d1_at_7=21, d3_at_7=-9), path=path) == (
        'PATH_TOLERANCE_VIOLATED',
        'path_tolerance: error of d3 is -9 um at 0.0015 s; allowed: 5 um',
    )


def test_path_tolerance_applies_from_start_to_end_only():
    path = [JointTolerance('d3', 5 * UM)]
    check(cycle(d3_at_3=9, d3_at_10=9), path=path)
    for sample in (START, END - 1):
        assert refused(cycle(**{f'd3_at_{sample}': 9}), path=path)[0] == 'PATH_TOLERANCE_VIOLATED'


def test_goal_is_met_when_all_joints_are_within_at_one_tick():
    goal = [JointTolerance('d1', 5 * UM), JointTolerance('d3', 5 * UM)]
    late = cycle(**{f'd1_at_{n}': 9 for n in range(10, 20)})
    assert refused(late, goal=goal) == (
        'GOAL_TOLERANCE_VIOLATED',
        'goal_tolerance: error of d1 is 9 um 0.0045 s after the end; allowed: 5 um',
    )
    late[13, 0] = 4 * UM
    check(late, goal=goal)
    late[13, 1] = 9 * UM  # the other joint is outside at this tick
    assert refused(late, goal=goal)[0] == 'GOAL_TOLERANCE_VIOLATED'


def test_goal_time_tolerance_bounds_the_wait():
    goal = [JointTolerance('d3', 5 * UM)]
    late = cycle(d3_at_10=9, d3_at_11=9, d3_at_12=9)
    check(late, goal=goal, goal_time=3 * STEP)
    assert '0.001 s after the end' in refused(late, goal=goal, goal_time=2 * STEP)[1]
    check(late, goal=goal, goal_time=100.0)  # longer than the cycle


def test_error_that_is_not_finite_is_outside_a_tolerance():
    code, text = refused(cycle(d3_at_7=nan), path=[JointTolerance('d3', 5 * UM)])
    assert (code, 'error of d3 is nan um' in text) == ('PATH_TOLERANCE_VIOLATED', True)


def test_bad_tolerances_are_refused_with_their_reason():
    allowed = 'allowed: 0 or more, or -1 (no tolerance)'
    for given, code, text in (
        (JointTolerance('d9', UM), 'INVALID_JOINTS', "path_tolerance: joints ['d9']; allowed: each of ['d1', 'd3']"),
        (JointTolerance('d1', -2.0), 'INVALID_GOAL', f'path_tolerance: position of d1 is -2; {allowed}'),
        (JointTolerance('d1', nan), 'INVALID_GOAL', f'position of d1 is nan; {allowed}'),
        (JointTolerance('d1', inf), 'INVALID_GOAL', f'position of d1 is inf; {allowed}'),
        (JointTolerance('d1', 0.0, velocity=0.1), 'INVALID_GOAL', 'velocity of d1 is 0.1; expected 0 or -1'),
        (JointTolerance('d1', 0.0, acceleration=nan), 'INVALID_GOAL', f'acceleration of d1 is nan; {allowed}'),
    ):
        found = refused(path=[given])
        assert (found[0], text in found[1]) == (code, True), found
        assert refused(goal=[given]) == (code, found[1].replace('path_', 'goal_'))
    assert refused(path=2 * [JointTolerance('d1', UM)])[0] == 'INVALID_JOINTS'
    assert refused(goal_time=-0.5) == ('INVALID_GOAL', f'goal_time_tolerance is -0.5; {allowed}')
    tolerances_of(JOINTS, [JointTolerance('d1', UM, velocity=-1.0, acceleration=-1.0)])


def test_start_in_the_past_or_future_is_refused():
    for stamp in (0.0, 9.5, 10.0, 11.0):
        check_start(stamp, 1.0, now=10.0)
    for stamp, code in ((8.9, 'OLD_HEADER_TIMESTAMP'), (11.1, 'INVALID_GOAL'), (1.7e9, 'INVALID_GOAL')):
        with pytest.raises(FollowError, match=r'header\.stamp') as refusal:
            check_start(stamp, 1.0, now=10.0)
        assert refusal.value.code == code
