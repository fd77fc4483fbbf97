"""Limits of a motion: also between samples, and checked before a long trajectory is computed."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from pkm_core.config import ConfigError
from pkm_core.errors import TrajectoryError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import ArcTarget, Motion, Pose, Target, load_motion, plan
from pkm_core.motion.profiles import MotionLimits
from pkm_core.motion.trajectory import checked_cycle, checked_joints, to_joints

PLANAR = load_machine('planar')
MOVE = Target(by={'d1': 5e-3, 'd3': 5e-3})
RUCKIG = {'speed': 1e-6, 'acceleration': 1.0, 'jerk': 100.0}


def motion(**options):
    return Motion(machine='planar', **{'targets': [MOVE], **options})


def test_jump_between_samples_is_refused_with_the_shortest_time():
    """Its speed and thrust are zero at every sample, and 10 m/s between two of them."""
    with pytest.raises(TrajectoryError, match=r'd1 at sample 40 to the next moves at 10\.000 m/s') as refusal:
        plan(PLANAR, motion(move_time=0.5e-3))
    shortest = float(str(refusal.value).partition('shortest allowed move_time: ')[2].split()[0]) * 1e-3
    plan(PLANAR, motion(move_time=shortest))
    with pytest.raises(TrajectoryError):
        plan(PLANAR, motion(move_time=shortest - PLANAR.sample_time))


@pytest.mark.parametrize(('size', 'reason'), [(8e-3, 'moves at 16'), (100e-6, 'and its neighbours need')])
def test_position_that_jumps_without_derivatives_is_refused(size, reason):
    """A message can have this: positions with a jump, and zero speed and acceleration."""
    joints = to_joints(PLANAR, plan(PLANAR, load_motion('planar_80ms')))
    position = joints.position.copy()
    position[10:, 0] += size
    with pytest.raises(TrajectoryError, match=reason):
        checked_joints(PLANAR, replace(joints, position=position))


@pytest.mark.parametrize(
    'options',
    [
        {'limits': MotionLimits(speed=150e-6)},
        {'limits': MotionLimits(speed=1e-6)},
        {'limits': MotionLimits(**RUCKIG), 'profile': 'ruckig'},
        {'limits': MotionLimits(speed=0.1), 'lead_rest': 1e6},
        {'limits': MotionLimits(speed=0.01), 'targets': [MOVE, Target(by={'d1': -5e-3, 'd3': -5e-3})] * 400},
    ],
    ids=['slow', 'endless', 'ruckig', 'rest', 'many'],
)
def test_cycle_over_the_longest_is_refused_before_it_is_made(options):
    """1 um/s took 12 GB before."""
    tracemalloc.start()
    with pytest.raises(TrajectoryError, match='allowed 20 s'):
        plan(PLANAR, motion(**options))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100e6


def test_arc_with_its_via_in_the_wrong_unit_is_refused_at_once():
    home = dict(zip(PLANAR.coordinates, PLANAR.forward(PLANAR.home), strict=True))
    arc = ArcTarget(to=Pose(x=home['x'] + 1e-3, y=home['y']), via=Pose(x=home['x'] * 1e3, y=home['y'] + 1.0))
    with pytest.raises((TrajectoryError, ValueError), match=r'allowed|out of reach|cannot'):
        plan(PLANAR, motion(targets=[Target(arc=arc)], limits=MotionLimits(speed=0.1)))


@pytest.mark.parametrize('name', ['move_time', 'settle_window'])
def test_duration_below_a_sample_is_refused(name):
    with pytest.raises(TrajectoryError, match=f'{name} is 1e-12 s; expected at least 0.5 ms'):
        plan(PLANAR, motion(**{name: 1e-12}))


def test_fastest_profiles_of_the_limits_pass_between_samples():
    for profile in ('p7', 's4'):
        plan(PLANAR, motion(limits=MotionLimits(speed=0.5, acceleration=15.0), profile=profile))


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('targets: []', 'targets: has 0 entries; expected at least 1$'),
        ('targets: [{by: {d1: "1,5 mm"}}]', "targets.0.by.d1: '1,5 mm' has a decimal comma"),
        ('targets: [{by: {d1: 5 mm}}]\nmove_time: 080 ms', 'move_time: .* leading zero'),
    ],
)
def test_motion_file_is_refused_in_one_sentence(text, reason, tmp_path):
    path = tmp_path / 'motion.yaml'
    path.write_text(f'machine: planar\n{text}\n')
    with pytest.raises(ConfigError, match=reason) as refusal:
        load_motion(path)
    assert len(str(refusal.value).splitlines()) == 1


def test_motion_of_merged_targets_is_planned(tmp_path):
    path = tmp_path / 'motion.yaml'
    path.write_text('machine: planar\ntargets:\n  - by: &first {d1: 5 mm, d3: 5 mm}\n  - by: {<<: *first, d3: -5 mm}\n')
    targets = load_motion(path).targets
    assert targets[1].by == {'d1': 5e-3, 'd3': -5e-3}
    assert np.isfinite(plan(PLANAR, load_motion(path)).position).all()


def test_refused_model_is_an_error_of_its_fields():
    with pytest.raises(ValidationError, match='at least 1'):
        motion(targets=[])


@pytest.mark.parametrize(('part', 'where'), [(slice(None), 'first'), (slice(-40, None), 'last')])
def test_cycle_that_does_not_begin_and_end_at_home_is_refused(part, where):
    """3 mm elsewhere: the whole motion, or its end, which then drifts away slowly."""
    joints = to_joints(PLANAR, plan(PLANAR, load_motion('planar_80ms')))
    position = joints.position.copy()
    checked_cycle(PLANAR, joints)
    position[part, 1] += np.linspace(0.0, 1e-5, 40) if where == 'last' else 3e-3
    with pytest.raises(TrajectoryError, match=f'd3 is .* mm from home at the {where} sample; allowed 1 um'):
        checked_cycle(PLANAR, replace(joints, position=position))
