"""The barrier of a tick: which answers count, which are missing, and when the wait is over."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pkm_core.servo.tick_barrier import TickBarrier

TIMEOUT = 5.0
NOT_FINITE = 'answered with {} V; expected a finite voltage'


def barrier_at(tick=7, *, answered=(), is_open=True):
    """Return a barrier of two joints that awaits `tick` since 100 s, with the answers of `answered` taken."""
    barrier = TickBarrier(2, TIMEOUT)
    barrier.tick = tick
    if is_open:
        barrier.open(100.0)
    for joint in answered:
        assert not barrier.answer(joint, tick, 1.0)
    return barrier


@pytest.mark.parametrize(
    ('before', 'answer', 'completes', 'missing', 'volts', 'stale', 'complaints'),
    [
        pytest.param({}, (0, 7, 2.5), False, [1], [2.5, 0.0], [0, 0], {}, id='first'),
        pytest.param({'answered': [0]}, (1, 7, 2.5), True, [], [1.0, 2.5], [0, 0], {}, id='last'),
        pytest.param({'answered': [1]}, (0, 7, 2.5), True, [], [2.5, 1.0], [0, 0], {}, id='last, other order'),
        pytest.param({}, (1, 6, 2.5), False, [0, 1], [0.0, 0.0], [0, 1], {}, id='earlier tick'),
        pytest.param({}, (1, 8, 2.5), False, [0, 1], [0.0, 0.0], [0, 1], {}, id='later tick'),
        pytest.param({'answered': [1]}, (1, 7, 2.5), False, [0], [0.0, 1.0], [0, 1], {}, id='second answer'),
        pytest.param({'is_open': False}, (0, 7, 2.5), False, [], [0.0, 0.0], [1, 0], {}, id='closed'),
        *(
            pytest.param({}, (1, 7, bad), False, [0, 1], [0.0, 0.0], [0, 0], {1: NOT_FINITE.format(bad)}, id=str(bad))
            for bad in (math.nan, math.inf, -math.inf)
        ),
        pytest.param({'answered': [1]}, (1, 7, math.nan), False, [0], [0.0, 1.0], [0, 1], {}, id='second, nan'),
    ],
)
def test_answer(before, answer, completes, missing, volts, stale, complaints):
    barrier = barrier_at(**before)
    assert barrier.answer(*answer) is completes
    assert (barrier.missing, barrier.volts, barrier.stale) == (missing, volts, stale)
    assert (barrier.is_open, barrier.complaints) == (bool(missing), complaints)


def test_finite_answer_follows_one_that_was_not():
    barrier = barrier_at(answered=[0])
    assert not barrier.answer(1, 7, math.nan)
    assert barrier.answer(1, 7, 3.0)
    assert barrier.volts == [1.0, 3.0]


@pytest.mark.parametrize(
    ('before', 'now', 'overdue'),
    [
        pytest.param({}, 105.0, [], id='within the timeout'),
        pytest.param({}, 105.1, [0, 1], id='no answer'),
        pytest.param({'answered': [0]}, 105.1, [1], id='one answer'),
        pytest.param({'is_open': False}, 1e9, [], id='closed'),
    ],
)
def test_overdue_joints_after_the_timeout(before, now, overdue):
    assert barrier_at(**before).overdue(now) == overdue


def test_waiting_time_counts_from_open():
    assert barrier_at().waited(102.5) == 2.5


@pytest.mark.parametrize(('end', 'tick'), [(TickBarrier.next_tick, 8), (TickBarrier.close, 7)])
def test_barrier_closes_with_a_tick_or_without(end, tick):
    barrier = barrier_at(answered=[0])
    barrier.answer(1, 7, math.nan)
    end(barrier)
    assert (barrier.tick, barrier.is_open, barrier.missing, barrier.complaints) == (tick, False, [], {})
    assert not barrier.answer(1, tick, 2.0)
    assert (barrier.volts, barrier.stale) == ([1.0, 0.0], [0, 1])


ANSWERS = st.tuples(
    st.integers(0, 2), st.integers(-1, 1), st.floats(-10.0, 10.0) | st.sampled_from([math.nan, math.inf])
)


@given(st.lists(ANSWERS | st.sampled_from(['open', 'close']), max_size=60))
def test_ticks_advance_only_with_one_answer_per_joint(events):
    """The applied volts of each tick equal the first finite answers to this tick, whatever else arrives."""
    barrier = TickBarrier(3, TIMEOUT)
    first = {}  # finite answers to the awaited tick, by joint
    awaited = False
    counted = 0
    for event in events:
        if event in ('open', 'close'):
            (barrier.open(0.0) if event == 'open' else barrier.close())
            awaited, first = event == 'open', {}
            continue
        joint, shift, voltage = event
        before = list(barrier.volts)
        applies = awaited and shift == 0 and joint not in first
        counted += not applies
        completes = barrier.answer(joint, barrier.tick + shift, voltage)
        if applies and math.isfinite(voltage):
            first[joint] = voltage
            before[joint] = voltage
        assert barrier.volts == before
        assert completes == (applies and joint in first and len(first) == 3)
        assert sum(barrier.stale) == counted
        if completes:
            assert barrier.volts == [first[j] for j in range(3)]
            barrier.next_tick()
            awaited, first = False, {}


def test_late_answers_are_counted_once_per_tick():
    barrier = barrier_at(7, answered=[0])
    for now in (100.01, 100.2, 100.4):
        barrier.look(now)
    assert (barrier.late, barrier.longest) == (1, pytest.approx(0.4))
    barrier.answer(1, 7, 1.0)
    barrier.look(109.0)  # closed
    barrier.next_tick()
    barrier.open(110.0)
    barrier.look(110.3)
    assert (barrier.late, barrier.longest) == (2, pytest.approx(0.4))
