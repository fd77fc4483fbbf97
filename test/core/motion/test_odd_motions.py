"""Motion files from bug reports (`inputs`), coordinates that a machine lacks, and moves in which nothing moves."""

from dataclasses import replace
from math import isnan, nan
from pathlib import Path

import numpy as np
import pytest

from pkm_core.errors import ConfigError, PkmError, TrajectoryError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import ArcTarget, Motion, Pose, Target, load_motion, plan, pose_rows, still_moves
from pkm_core.motion.trajectory import to_joints

INPUTS = Path(__file__).parent / 'inputs'
PLANAR = load_machine('planar')
HOME = dict(zip(PLANAR.coordinates, PLANAR.forward(PLANAR.home).tolist(), strict=True))
REFUSED = {
    'decimal_comma': r"targets\.0\.by\.d1: '1,5 mm' has a decimal comma",
    'leading_zero': "move_time: '080 ms' has a leading zero; write '80'",
    'no_targets': 'targets: has 0 entries; expected at least 1$',
    'one_sample': r'moves at 10\.000 m/s; allowed 0\.8 m/s; shortest allowed move_time: 16\.5 ms',
}


@pytest.mark.parametrize('name', REFUSED)
def test_motion_of_a_bug_report_is_refused_by_its_fault(name):
    with pytest.raises(PkmError, match=REFUSED[name]):
        plan(PLANAR, load_motion(INPUTS / f'{name}.yaml'))


def test_motion_with_a_merge_key_moves_as_written():
    motion = load_motion(INPUTS / 'merge_key.yaml')
    assert [target.by for target in motion.targets] == [{'d1': 5e-3, 'd3': 5e-3}, {'d1': 5e-3, 'd3': -5e-3}]
    assert still_moves(PLANAR, plan(PLANAR, motion)) == ''


def test_motion_of_zero_length_is_planned_and_named():
    joints = to_joints(PLANAR, plan(PLANAR, load_motion(INPUTS / 'zero_length.yaml')))
    assert still_moves(PLANAR, joints) == 'planar: nothing moves in 1 of 1 moves: [1]'
    assert not np.ptp(joints.position, axis=0).any()


def test_one_move_without_motion_is_named_among_others():
    targets = [Target(by={'d1': 2e-3}), Target(by={'d1': 0.0})]
    assert still_moves(PLANAR, plan(PLANAR, Motion(machine='planar', targets=targets))).endswith('1 of 3 moves: [2]')


def test_cycle_without_motion_has_no_settling_time(write_bag, make_cycle):
    """Its error is that of standing; 0 ms would look as if the axes had arrived."""
    from pkm_core.bag.cycle_record import read_cycle

    record = read_cycle(write_bag(make_cycle('planar')))
    assert record.moves
    assert not any(isnan(each.settling_time_5um) for each in record.metrics())
    standing = replace(record, reference=np.zeros_like(record.reference))
    assert not standing.moves
    assert all(isnan(each.settling_time_5um) and isnan(each.settling_time_1um) for each in standing.metrics())
    assert standing.metrics()[0].max_dynamic_error == record.metrics()[0].max_dynamic_error


@pytest.mark.parametrize(
    ('extra', 'reason'),
    [
        ({'z': nan}, 'pose 1: z is nan m; planar has no z, expected 0'),
        ({'phi': 3.0}, 'pose 1: phi is 3 rad; planar has no phi, expected 0'),
    ],
)
def test_coordinate_that_the_machine_lacks_must_be_zero(extra, reason):
    zero = {'z': 0.0, 'phi': -0.0}
    assert pose_rows(PLANAR, [HOME | zero]).tolist() == [list(HOME.values())]
    with pytest.raises(TrajectoryError, match=reason):
        pose_rows(PLANAR, [HOME, HOME | zero | extra])


@pytest.mark.parametrize('kind', ['pose', 'line', 'arc'])
def test_coordinate_that_the_machine_lacks_is_refused_in_files(kind):
    def target(**extra):
        there = Pose(**{**HOME, 'x': HOME['x'] + 1e-3}, **extra)
        via = Pose(x=HOME['x'] + 5e-4, y=HOME['y'] + 1e-4)
        return Target(**{kind: ArcTarget(to=there, via=via) if kind == 'arc' else there})

    plan(PLANAR, Motion(machine='planar', targets=[target(z=0.0)]))
    with pytest.raises(TrajectoryError, match=r'target 0.*: z is 0\.01 m; planar has no z, expected 0'):
        plan(PLANAR, Motion(machine='planar', targets=[target(z=0.01)]))


def test_coordinate_that_is_no_number_is_refused_in_a_file(tmp_path):
    path = tmp_path / 'odd.yaml'
    path.write_text('machine: planar\ntargets: [{pose: {x: 1 mm, y: 2 mm, z: .nan}}]\n')
    with pytest.raises(ConfigError, match=r'targets\.0\.pose\.z: nan has no unit'):
        load_motion(path)
