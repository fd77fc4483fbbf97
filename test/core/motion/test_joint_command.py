"""Commands of joint positions over time: interpolation, and what is refused."""

from dataclasses import replace
from math import nan

import numpy as np
import pytest

from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.motion.joint_command import Point, sampled_command
from pkm_core.motion.trajectory import checked_joints

MACHINE = load_machine('planar')
HOME = MACHINE.home
LEAD = 40  # samples of rest before the first one
MM = 1e-3


def point(time, *by, **values):
    """Return the point at `by` [mm] from home."""
    return Point(time, tuple(HOME + MM * np.array(by)), **values)


def sampled(*points, names=MACHINE.joints, start=HOME):
    return sampled_command(MACHINE, names, points, start)


def test_positions_alone_are_joined_by_lines():
    joints = sampled(point(0.1, 1, -1), point(0.2, 3, -1))
    at = joints.position[LEAD:][[0, 100, 200, 300, 400]]
    np.testing.assert_allclose((at - HOME) / MM, [[0, 0], [0.5, -0.5], [1, -1], [2, -1], [3, -1]], atol=1e-9)
    assert joints.velocity[LEAD + 100] == pytest.approx([0.01, -0.01])


def test_velocities_make_cubic_polynomials():
    """From rest to 2 mm and 10 mm/s in 0.2 s: p = 3 u^2 (2 - 2/3) - 2 u^3 (2 - 1) mm with u = t/0.2 s."""
    joints = sampled(
        point(0.2, 2, 0, velocities=(0.01, 0.0)),
        point(0.4, 4, 0, velocities=(0.0, 0.0)),
    )
    half = (joints.position[LEAD + 200, 0] - HOME[0]) / MM
    assert half == pytest.approx(3 * 0.25 * 2 - 2 * 0.125 * 2 + (0.125 - 0.25) * 0.01 * 0.2 / MM)
    assert joints.velocity[LEAD + 400, 0] == pytest.approx(0.01)
    assert np.abs(joints.velocity[[0, -1]]).max() == 0


def test_accelerations_make_quintic_polynomials():
    still = {'velocities': (0.0, 0.0), 'accelerations': (0.0, 0.0)}
    joints = sampled(point(0.2, 2, 1, **still))
    u = np.arange(400) / 400
    expected = 10 * u**3 - 15 * u**4 + 6 * u**5
    np.testing.assert_allclose((joints.position[LEAD : LEAD + 400, 0] - HOME[0]) / MM, 2 * expected, atol=1e-9)
    assert joints.acceleration[LEAD + 100, 0] == pytest.approx(2 * MM / 0.2**2 * (60 * 0.25 - 180 / 16 + 120 / 64))


def test_values_follow_the_order_of_the_names():
    swapped = Point(0.1, tuple((HOME + MM * np.array([1, 2]))[::-1]))
    joints = sampled(swapped, names=('d3', 'd1'))
    np.testing.assert_allclose(joints.position[-1] - HOME, [MM, 2 * MM], atol=1e-12)


def test_command_ends_on_the_last_point_between_two_samples():
    joints = sampled(point(0.10012, 1, 0))
    assert joints.move_ends.tolist() == [LEAD + 201]
    assert joints.position[LEAD + 200, 0] < joints.position[LEAD + 201, 0]
    np.testing.assert_array_equal(joints.position[LEAD + 201], joints.position[-1])
    checked_joints(MACHINE, joints)


def test_first_point_at_the_start_may_be_read_from_the_encoders():
    joints = sampled(point(0.0, 0.02, 0), point(0.1, 1, 0))
    np.testing.assert_array_equal(joints.position[0], HOME)


@pytest.mark.parametrize(
    ('points', 'text'),
    [
        ([], '0 points; expected at least 1'),
        ([point(0.2, 1, 1), point(0.1, 2, 1)], 'point 1 is 0.1 s, of point 0 0.2 s; expected increasing times'),
        ([point(0.2, 1, 1), point(0.2, 2, 1)], 'expected increasing times'),
        ([point(-0.1, 1, 1)], 'time_from_start of point 0 is -0.1 s; allowed: 0 or more'),
        ([point(nan, 1, 1)], 'time_from_start of point 0 is nan s'),
        ([point(0.0, 0, 0)], 'takes 0 s; allowed: more than 0, up to 20 s'),
        ([point(21.0, 1, 1)], 'takes 21 s; allowed: more than 0, up to 20 s'),
        ([replace(point(0.1, 1, 1), positions=(0.08,))], 'point 0: 1 positions; expected 2'),
        ([replace(point(0.1, 1, 1), positions=())], 'point 0: 0 positions; expected 2'),
        ([point(0.1, 1, 1, velocities=(0.0,))], 'point 0: 1 velocities; expected 0 or 2'),
        ([point(0.1, 1, 1, effort=(1.0, 1.0))], 'point 0: 2 effort; expected 0'),
        ([point(0.1, 1, 1, accelerations=(0.0, 0.0))], 'accelerations without velocities'),
        (
            [point(0.1, 1, 1), point(0.2, 1, 1, velocities=(0.0, 0.0))],
            'point 1 gives .*velocities.*, point 0 .*the same',
        ),
        ([point(0.1, nan, 1)], 'point 0: positions of d1 is nan; expected a finite number'),
        ([point(0.1, 1, 1, velocities=(0.0, nan))], 'point 0: velocities of d3 is nan'),
        ([point(0.1, 1, 1, velocities=(0.0, 0.1))], 'last point: velocities of d3 is 0.1; expected 0'),
        (
            [point(0.0, 0.2, 0), point(0.1, 1, 1)],
            'begins 0.2 mm from where the machine stands, d1 = 79.5 mm; allowed 0.1',
        ),
        (
            [point(0.1, 1, 1), point(0.5, 50, 1)],
            r'point 1: by d1 49 mm.* out of reach; d1 may move by .* \(d1 = 129.5 mm',
        ),
    ],
)
def test_command_is_refused_by_its_fault(points, text):
    with pytest.raises(PkmError, match=f'joint trajectory: .*{text}'):
        sampled(*points)


@pytest.mark.parametrize('names', [('d1',), ('d1', 'd1'), ('d1', 'd9'), ('d1', 'd3', 'd5'), ()])
def test_joint_names_must_be_those_of_the_machine(names):
    with pytest.raises(PkmError, match=r"joint names \[.*\]; expected each of \['d1', 'd3'\] once"):
        sampled(point(0.1, 1, 1), names=names)


def test_step_of_a_command_exceeds_the_limits():
    with pytest.raises(PkmError, match=r'd1 at sample 40 moves at 2.000 m/s; allowed 0.8 m/s'):
        checked_joints(MACHINE, sampled(point(0.005, 10, 0)))
