"""The stream of a jog: one table of events, and random sequences of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pkm_core.errors import TrajectoryError
from pkm_core.servo.jog_stream import END_AFTER, SILENCE, JogState, JogStream

PERIOD = 0.015
UP, STILL = np.array([0.0, 1e-3]), np.zeros(2)
IDLE, STARTING, JOGGING, ENDING, BLOCKED = JogState


def stream_in(state):
    """Return a stream in `state`, reached at 0 s; JOGGING has used its first piece, and the next one is due."""
    stream = JogStream(PERIOD)
    if state is BLOCKED:
        stream.block(0.0)
    elif state is not IDLE:
        assert stream.commanded(-PERIOD, '/a', UP)
        stream.begun(-PERIOD, '/a', UP)
    if state is JOGGING:
        stream.commanded(0.0, '/a', UP)
        stream.accepted()
    if state is ENDING:
        stream.stop()
    assert stream.state is state
    return stream


TABLE = [
    # (state, event, result, state after)
    (IDLE, ('commanded', 0.0, '/a', UP), True, IDLE),  # begins: the caller plans the first piece
    (IDLE, ('commanded', 0.0, '/a', STILL), False, IDLE),
    (STARTING, ('commanded', 0.0, '/a', UP), False, STARTING),
    (JOGGING, ('commanded', 0.0, '/a', UP), False, JOGGING),
    (ENDING, ('commanded', 0.0, '/a', UP), False, ENDING),
    (BLOCKED, ('commanded', END_AFTER / 2, '/a', UP), False, BLOCKED),
    (BLOCKED, ('commanded', END_AFTER, '/a', UP), True, IDLE),
    *((state, ('accepted',), None, state) for state in (IDLE, JOGGING, ENDING, BLOCKED)),
    (STARTING, ('accepted',), None, JOGGING),
    *((state, ('due', 9.0), None, state) for state in (IDLE, STARTING, ENDING, BLOCKED)),
    (JOGGING, ('due', SILENCE), UP.tolist(), JOGGING),
    (JOGGING, ('due', SILENCE + 0.001), STILL.tolist(), JOGGING),  # silent: the platform stops
    (JOGGING, ('due', END_AFTER + 0.001), None, ENDING),
    (JOGGING, ('due', -0.001), None, JOGGING),  # a piece per period
    *((state, ('stop',), None, ENDING) for state in (STARTING, JOGGING, ENDING)),
    *((state, ('stop',), None, state) for state in (IDLE, BLOCKED)),
    *((state, ('block', 0.0), None, BLOCKED) for state in (IDLE, BLOCKED)),
    (STARTING, ('ended',), None, IDLE),
    (JOGGING, ('ended',), None, IDLE),
    (ENDING, ('ended',), None, BLOCKED),  # stopped for a reason that a stream that continues must not overrule
]


@pytest.mark.parametrize(('state', 'event', 'result', 'after'), TABLE, ids=lambda value: str(value)[:40])
def test_event_in_state(state, event, result, after):
    stream = stream_in(state)
    name, *arguments = event
    found = getattr(stream, name)(*arguments)
    assert (found.tolist() if isinstance(found, np.ndarray) else found) == result
    assert stream.state is after


def test_second_commander_is_refused_and_both_are_named():
    stream = stream_in(JOGGING)
    with pytest.raises(TrajectoryError, match=r'^jog of /b: the jog of /a is running; wait until it has been silent'):
        stream.commanded(0.0, '/b', UP)
    np.testing.assert_array_equal(stream.due(0.0), UP)


def test_commander_is_known_by_its_publisher_not_by_its_name():
    """The graph tells the name of a new node some time after its first message."""
    stream = JogStream(PERIOD)
    assert stream.commanded(0.0, 'unknown', UP, b'1')
    stream.begun(0.0, 'unknown', UP, b'1')
    assert stream.commanded(0.01, '/a', UP, b'1') is False
    with pytest.raises(TrajectoryError, match='jog of /a: the jog of /a is running'):
        stream.commanded(0.01, '/a', UP, b'2')


def test_no_piece_is_due_before_the_machine_uses_the_last_one():
    stream = stream_in(JOGGING)
    assert stream.due(0.0) is not None
    stream.commanded(1.0, '/a', UP)
    assert stream.due(1.0) is None
    stream.accepted()
    assert stream.due(1.0) is not None


def test_stream_that_returns_before_the_end_is_followed_again():
    stream = stream_in(JOGGING)
    assert not stream.due(0.1).any()
    stream.accepted()
    stream.commanded(0.2, '/a', UP)
    assert stream.due(0.2).any()


def test_stream_after_a_silent_end_begins_the_next_jog():
    stream = stream_in(JOGGING)
    assert stream.due(END_AFTER + 0.1) is None
    assert stream.commanded(END_AFTER + 0.2, '/a', UP) is False  # the machine has not ended the cycle yet
    stream.ended()
    assert stream.commanded(END_AFTER + 0.21, '/a', UP)


EVENTS = st.one_of(
    st.tuples(st.just('commanded'), st.sampled_from(['/a', '/a', '/b']), st.sampled_from([UP, UP, STILL])),
    st.tuples(st.just('wait'), st.sampled_from([0.01, 0.03, 0.4])),
    st.tuples(st.sampled_from(['accepted', 'due', 'due', 'stop', 'ended'])),
)


@given(events=st.lists(EVENTS, min_size=20, max_size=60))
def test_platform_moves_only_for_a_fresh_message(events):
    """A moving piece has a message of the commander within `SILENCE` before it; pieces come one per period at most."""
    stream, now, heard, pieces, used = JogStream(PERIOD), 0.0, {}, [], True
    for name, *arguments in events:
        if name == 'wait':
            now += arguments[0]
        elif name == 'commanded':
            before = stream.commander
            try:
                if stream.commanded(now, *arguments):
                    stream.begun(now, *arguments)
                    pieces, used = [], False
                heard[arguments[0]] = now
            except TrajectoryError:
                assert before not in ('', arguments[0])
        elif name == 'due':
            twist = stream.due(now)
            if twist is None:
                continue
            assert used
            used = False
            assert not twist.any() or now - heard[stream.commander] <= SILENCE
            pieces.append(now)
            assert len(pieces) <= (now - pieces[0]) / PERIOD + 2  # one may be late and the next one in time
        else:
            used = used or name == 'accepted'
            if name != 'ended' or stream.runs:
                getattr(stream, name)()
