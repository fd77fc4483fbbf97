"""Pieces of a jog: continuity, limits, the stop that ends each of them, and the whole that controllers make of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pkm_core.control.feasibility import drive_check
from pkm_core.control.model import load_model
from pkm_core.errors import TrajectoryError
from pkm_core.machines import load_machine
from pkm_core.motion.jog import FASTEST, FASTEST_TURN, PERIOD, RISE, ROUND, JogPlanner, check_twist
from pkm_core.motion.pieces import checked_piece, joined
from pkm_core.motion.planning import LONGEST_CYCLE
from pkm_core.motion.trajectory import checked_cycle, to_joints
from pkm_core.servo.jog_stream import JogStream

STEP = round(PERIOD / 0.5e-3)


@pytest.fixture(scope='module', params=['four_dof', 'planar', 'xy_stage'])
def machine(request):
    return load_machine(request.param)


def planner_of(machine, start=None):
    return JogPlanner(machine, machine.home if start is None else start, drive_check(machine, load_model(machine)))


def fastest(machine):
    return np.array([FASTEST_TURN if name == 'phi' else FASTEST for name in machine.coordinates])


def whole_of(pieces):
    whole = pieces[0].poses
    for piece in pieces[1:]:
        whole = joined(whole, piece.offset, piece.poses)
    return whole


def test_jog_moves_with_the_commanded_velocity_and_ends_at_rest(machine):
    planner, twist = planner_of(machine), 0.1 * fastest(machine)
    pieces = [planner.next(twist) for _ in range(6)]
    whole = whole_of(pieces)
    assert [piece.offset for piece in pieces] == [STEP * number for number in range(6)]
    assert not whole.velocity[: STEP + 1].any()  # the machine starts the first piece when every node is ready
    np.testing.assert_allclose(whole.velocity[3 * STEP], twist, rtol=1e-12)
    assert not any(rows[-1].any() for rows in (whole.velocity, whole.acceleration, whole.jerk))
    moved = whole.position[-1] - whole.position[0]
    np.testing.assert_allclose(moved, 5 * PERIOD * twist, rtol=1e-9)  # as long as it was commanded
    joints = to_joints(machine, whole)
    np.testing.assert_array_equal(joints.position[-1], pieces[-1].end)
    checked_cycle(machine, joints, machine.home, stay=True)


def test_every_piece_stops_within_the_time_of_its_brake(machine):
    planner = planner_of(machine)
    for _ in range(3):
        piece = planner.next(0.2 * fastest(machine))
    after = piece.hold - piece.offset + round((RISE + ROUND) / machine.sample_time)
    assert piece.poses.velocity[after - 2].any()
    assert not piece.poses.velocity[after:].any()


@settings(max_examples=20, deadline=None)
@given(parts=st.lists(st.lists(st.sampled_from([-1.0, 0.0, 0.3, 1.0]), min_size=4, max_size=4), max_size=12))
def test_any_stream_is_continuous_and_within_the_limits(parts):
    """At full speed, with a reversal in every piece: the rows are one smooth motion that every check accepts."""
    machine = load_machine('four_dof')
    planner = planner_of(machine)
    pieces = [planner.next(fastest(machine) * part) for part in [[0] * 4, *parts]]
    whole, step = whole_of(pieces), machine.sample_time
    joints = to_joints(machine, whole)
    drive_check(machine, load_model(machine))(joints)
    # the jerk is constant within a sample: the trapezoidal rule is exact for the acceleration
    cubic = step**2 / 12.0 * np.abs(whole.jerk).max(axis=0)
    for lower, upper, bound in (('position', 'velocity', cubic), ('velocity', 'acceleration', 0.0)):
        rate = np.diff(getattr(whole, lower), axis=0) / step
        mean = 0.5 * (getattr(whole, upper)[1:] + getattr(whole, upper)[:-1])
        assert (np.abs(rate - mean) <= bound * (1.0 + 1e-9) + 1e-9).all()


def test_jog_stops_before_the_border_and_names_it_once(machine):
    """The message has the interval of each coordinate; computed once, because that takes a while."""
    planner, twist = planner_of(machine), fastest(machine) * ([0, 0, 1, 0] if machine.name == 'four_dof' else [1, 0])
    pieces = [planner.next(twist) for _ in range(45)]
    limited = [piece.limited for piece in pieces]
    first = next(number for number, text in enumerate(limited) if text)
    assert all(limited[first:])
    assert len(set(limited[first:])) == 1
    assert 'allowed' in limited[-1]
    whole = whole_of(pieces)
    checked_cycle(machine, to_joints(machine, whole), machine.home, stay=True)
    np.testing.assert_array_equal(whole.position[-STEP:], np.broadcast_to(whole.position[-1], (STEP, len(twist))))
    back = planner.next(-twist)  # away from the border it moves again
    assert not back.limited
    assert (back.poses.position[STEP] - back.poses.position[0]) @ twist < 0


@pytest.mark.parametrize('way', [0.0, 0.014], ids=lambda way: f'{1e3 * way:g} ms')
@pytest.mark.parametrize('last', [0.1 + 0.003 * number for number in range(5)], ids=lambda last: f'{last:g} s')
def test_platform_rests_within_100_ms_of_the_last_message(way, last):
    """At pace 1: the machine drives a piece in its time, and has the next one `way` [s] after it was sent."""
    machine = load_machine('xy_stage')
    planner, stream, twist, step = planner_of(machine), JogStream(PERIOD), np.array([0.01, 0.0]), 1e-3
    stream.begun(-1.0, '/a', twist)  # the start of a cycle takes a while
    pieces, sent, sample, moved = [planner.next(twist)], [-1.0], 0, 0.0
    stream.accepted()
    for now in np.arange(0.0, last + 0.2, step):
        if now <= last:
            stream.commanded(now, '/a', twist)
        if sample >= pieces[0].hold and len(pieces) > 1 and now >= sent[1] + way:
            del pieces[0], sent[0]
            stream.accepted()
        if sample < pieces[0].hold:  # else the machine waits
            if pieces[0].poses.velocity[sample - pieces[0].offset].any():
                moved = now
            sample += round(step / machine.sample_time)
        if (due := stream.due(now)) is not None:
            pieces.append(planner.next(due))
            sent.append(now)
    assert last + 0.06 < moved < last + 0.1


def test_longest_jog_comes_to_rest(machine):
    planner = planner_of(machine)
    planner._at = round(LONGEST_CYCLE / machine.sample_time)
    assert planner.is_long
    assert not planner.next(fastest(machine)).poses.velocity.any()


@pytest.mark.parametrize(
    ('twist', 'text'),
    [
        ({'x': float('nan')}, 'jog: velocity of x is nan m/s; expected a finite number'),
        ({'phi': float('inf')}, 'jog: velocity of phi is inf rad/s; expected a finite number'),
        ({'x': 0.06}, 'jog: velocity of x is 0.06 m/s; allowed -0.05 to 0.05 m/s'),
        ({'phi': -0.6}, 'jog: velocity of phi is -0.6 rad/s; allowed -0.5 to 0.5 rad/s'),
        ({'wx': 0.1}, 'jog: velocity of wx is 0.1 rad/s; four_dof moves x, y, z, phi only: expected 0'),
    ],
)
def test_twist_that_cannot_be_followed_is_refused(twist, text):
    everything = dict.fromkeys(('x', 'y', 'z', 'wx', 'wy', 'phi'), 0.0)
    with pytest.raises(TrajectoryError, match=f'^{text}$'):
        check_twist(load_machine('four_dof'), everything | twist)


def test_coordinate_that_the_machine_lacks_is_refused():
    with pytest.raises(TrajectoryError, match=r'velocity of z is 0\.01 m/s; xy_stage moves x, y only: expected 0'):
        check_twist(load_machine('xy_stage'), {'x': 0.0, 'y': 0.0, 'z': 0.01, 'phi': 0.0})


def test_piece_with_a_jump_is_refused():
    machine = load_machine('xy_stage')
    planner = planner_of(machine)
    first, second = (to_joints(machine, planner.next(np.array([0.01, 0.0])).poses) for _ in range(2))
    assert len(checked_piece(machine, first, STEP, second)) == STEP + len(second)
    second.position[:] += 1e-3
    with pytest.raises(TrajectoryError, match='x at sample 1 to the next moves at'):
        checked_piece(machine, first, STEP, second)


@pytest.mark.parametrize('offset', [0, -1, 10_000])
def test_piece_outside_the_cycle_is_refused(offset):
    machine = load_machine('xy_stage')
    piece = planner_of(machine).next(np.zeros(2)).poses
    with pytest.raises(TrajectoryError, match=f'piece at sample {offset}; allowed 1 to'):
        joined(piece, offset, piece)
