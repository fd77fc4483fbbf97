"""A goal's cycle: one table of every event in every state, and random sequences of events."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pkm_core.servo.goal_cycle import End, GoalCycle, GoalState, Send, StopCycle, WatchMachine

IDLE, STARTING, RUNNING, AWAITING_METRICS, ENDED, STRAY = GoalState
START_TIMEOUT, METRICS_TIMEOUT = 30.0, 2.0
EVENTS = {'begin', 'numbered', 'started', 'finished', 'failed', 'metrics', 'reported', 'look', 'stop'}
JOINTS = ['a', 'b']
HEARD = '1 node(s) listen to /pkm/pose_trajectory'
GONE = 'the machine that ran it is gone: its process has ended or cannot be reached; start it again'
NOT_STARTED = (
    f'cycle 1 did not start within 30.0 s; {HEARD}: are inverse_kinematics, joint_controllers and machine running?'
)


def cycle_in(state):
    """Return a cycle number 1 in `state`, reached by events at 100 s; AWAITING_METRICS has those of joint a."""
    cycle = GoalCycle(START_TIMEOUT, METRICS_TIMEOUT, silence=12.0)
    if state is not IDLE:
        cycle.begin(100.0)
    if state in (RUNNING, AWAITING_METRICS):
        cycle.started(1)
    if state is AWAITING_METRICS:
        cycle.metrics(1, 'a', 1e-6, JOINTS)
        cycle.finished(1, 100.0, JOINTS)
    if state in (ENDED, STRAY):
        cycle.failed(1, 'machine: door')
    if state is STRAY:
        cycle.started(1)
    assert cycle.state is state
    return cycle


def row(state, event, after, *actions):
    return pytest.param(state, event, after, actions, id=f'{state.value}-{event}')


TABLE = [
    # a cycle is begun; one that has not ended is given up
    row(IDLE, ('begin', 0.0), STARTING, Send(1)),
    *(row(state, ('begin', 0.0), STARTING, Send(2)) for state in GoalState if state is not IDLE),
    # the machine reports the number of its cycle
    *(row(state, ('numbered', 41), state) for state in GoalState),
    # STARTED
    row(IDLE, ('started', 0), IDLE),
    row(STARTING, ('started', 1), RUNNING, WatchMachine()),
    row(RUNNING, ('started', 1), RUNNING),
    row(AWAITING_METRICS, ('started', 1), AWAITING_METRICS),
    row(ENDED, ('started', 1), STRAY, WatchMachine()),
    row(STRAY, ('started', 1), STRAY),
    # FINISHED; no controller or all of them may report metrics
    row(IDLE, ('finished', 0, 100.0, []), IDLE),
    row(STARTING, ('finished', 1, 100.0, JOINTS), AWAITING_METRICS),
    row(STARTING, ('finished', 1, 100.0, []), ENDED, End()),
    row(RUNNING, ('finished', 1, 100.0, JOINTS), AWAITING_METRICS),
    row(RUNNING, ('finished', 1, 100.0, []), ENDED, End()),
    row(AWAITING_METRICS, ('finished', 1, 100.0, []), AWAITING_METRICS),
    row(ENDED, ('finished', 1, 100.0, []), ENDED),
    row(STRAY, ('finished', 1, 100.0, []), ENDED),
    # REFUSED or FAULT
    row(IDLE, ('failed', 0, 'machine: door'), IDLE),
    row(STARTING, ('failed', 1, 'machine: door'), ENDED, End('machine: door')),
    row(RUNNING, ('failed', 1, 'machine: door'), ENDED, End('machine: door')),
    row(AWAITING_METRICS, ('failed', 1, 'machine: door'), AWAITING_METRICS),
    row(ENDED, ('failed', 1, 'machine: door'), ENDED),
    row(STRAY, ('failed', 1, 'machine: door'), ENDED),
    # metrics of a joint
    row(IDLE, ('metrics', 0, 'a', 1e-6, ['a']), IDLE),
    row(STARTING, ('metrics', 1, 'a', 1e-6, ['a']), STARTING),
    row(RUNNING, ('metrics', 1, 'a', 1e-6, ['a']), RUNNING),
    row(AWAITING_METRICS, ('metrics', 1, 'a', 2e-6, JOINTS), AWAITING_METRICS),
    row(AWAITING_METRICS, ('metrics', 1, 'b', 2e-6, JOINTS), ENDED, End(errors={'a': 1e-6, 'b': 2e-6})),
    row(AWAITING_METRICS, ('metrics', 1, 'c', 2e-6, ['a']), ENDED, End(errors={'a': 1e-6, 'c': 2e-6})),
    row(ENDED, ('metrics', 1, 'b', 2e-6, ['b']), ENDED),
    row(STRAY, ('metrics', 1, 'b', 2e-6, ['b']), STRAY),
    # diagnostics of the machine: one report ends nothing, the event comes first
    *(row(state, ('reported', 100.0, 'faulted', 1, 'door', []), state) for state in GoalState),
    # look: resend, or end a wait
    row(IDLE, ('look', 1e9, False, HEARD), IDLE),
    row(STARTING, ('look', 130.0, False, HEARD), STARTING, Send(1)),
    row(STARTING, ('look', 130.1, False, HEARD), ENDED, End(NOT_STARTED)),
    row(RUNNING, ('look', 1e9, False, HEARD), RUNNING),
    row(RUNNING, ('look', 101.0, True, HEARD), ENDED, StopCycle(1, GONE), End(f'cycle 1: {GONE}')),
    row(AWAITING_METRICS, ('look', 102.0, True, HEARD), AWAITING_METRICS),
    row(AWAITING_METRICS, ('look', 102.1, False, HEARD), ENDED, End(errors={'a': 1e-6})),
    row(ENDED, ('look', 1e9, True, HEARD), ENDED),
    row(STRAY, ('look', 1e9, False, HEARD), STRAY),
    row(STRAY, ('look', 101.0, True, HEARD), ENDED, StopCycle(1, GONE)),
    # stop: at once, or when it starts
    row(RUNNING, ('stop', 'cancelled'), RUNNING, StopCycle(1, 'cancelled')),
    *(row(state, ('stop', 'cancelled'), state) for state in GoalState if state is not RUNNING),
    # events of another cycle
    *(row(state, ('started', 7), state) for state in GoalState),
    *(row(state, ('finished', 7, 100.0, []), state) for state in GoalState),
    *(row(state, ('failed', 7, 'machine: door'), state) for state in GoalState),
    *(row(state, ('metrics', 7, 'b', 2e-6, []), state) for state in GoalState),
]


@pytest.mark.parametrize(('state', 'event', 'after', 'actions'), TABLE)
def test_event_in_state(state, event, after, actions):
    cycle = cycle_in(state)
    name, *arguments = event
    assert getattr(cycle, name)(*arguments) == actions
    assert cycle.state is after


def test_table_has_every_event_in_every_state():
    covered = {(param.values[0], param.values[1][0]) for param in TABLE}
    assert covered == {(state, event) for state in GoalState for event in EVENTS}


def test_cycle_is_numbered_after_the_last_one_of_the_machine():
    cycle = cycle_in(IDLE)
    cycle.numbered(41)
    cycle.numbered(7)
    cycle.numbered(2**32 - 1)  # forged: with it the counting would end
    assert cycle.next_cycle == 42
    assert cycle.begin(0.0) == (Send(42),)
    assert cycle.begin(0.0) == (Send(43),)


def test_cycle_stopped_before_its_start_stops_at_its_start():
    cycle = cycle_in(STARTING)
    cycle.stop('cancelled')
    assert cycle.started(1) == (WatchMachine(), StopCycle(1, 'cancelled'))
    assert cycle.failed(1, 'machine: cancelled') == (End('machine: cancelled'),)
    cycle.begin(0.0)
    assert cycle.started(2) == (WatchMachine(),)


def test_metrics_of_the_cycle_before_are_forgotten():
    cycle = cycle_in(AWAITING_METRICS)
    cycle.begin(0.0)
    cycle.metrics(1, 'b', 2e-6, JOINTS)
    assert cycle.finished(2, 0.0, []) == (End(),)


BY_NUMBER = ('started', 'finished', 'failed', 'metrics')
SHIFTS = st.sampled_from([-1, 0, 0, 0, 1])  # to the number of the cycle
RANDOM_EVENTS = st.one_of(
    st.tuples(st.just('numbered'), st.integers(0, 2)),
    st.tuples(st.just('started'), SHIFTS),
    st.tuples(st.just('finished'), SHIFTS, st.floats(0.0, 100.0), st.sampled_from([[], ['a'], JOINTS])),
    st.tuples(st.just('failed'), SHIFTS, st.just('machine: door')),
    st.tuples(st.just('metrics'), SHIFTS, st.sampled_from(JOINTS), st.just(1e-6), st.just(JOINTS)),
    st.tuples(st.just('look'), st.floats(0.0, 200.0), st.booleans(), st.just(HEARD)),
    st.tuples(st.just('begin'), st.floats(0.0, 100.0)),
)


@given(st.lists(RANDOM_EVENTS, min_size=30, max_size=80))
def test_random_events_end_each_cycle_at_most_once(events):
    """Messages are resent until STARTED only, and no number is given twice; events of other cycles have no effect."""
    cycle = GoalCycle(START_TIMEOUT, METRICS_TIMEOUT)
    begun, ended = [], []
    for name, *arguments in events:
        before = cycle.state
        if name in BY_NUMBER:
            arguments[0] += cycle.cycle
        actions = getattr(cycle, name)(*arguments)
        if name == 'begin':
            begun.append(cycle.cycle)
        elif name in BY_NUMBER and arguments[0] != cycle.cycle:
            assert (actions, cycle.state) == ((), before)
        for action in actions:
            match action:
                case Send(number):
                    assert (number, cycle.state) == (cycle.cycle, STARTING)
                case WatchMachine():
                    assert cycle.is_on_machine
                case StopCycle(number):
                    assert before in (RUNNING, STRAY)
                    assert cycle.state is ENDED
                case End():
                    assert cycle.state is ENDED
                    ended.append(cycle.cycle)
        if cycle.state in (ENDED, STRAY):
            assert ended[-1] == cycle.cycle
    assert begun == sorted(set(begun))
    assert ended == sorted(set(ended))


@pytest.mark.parametrize('before', [STARTING, RUNNING])
@pytest.mark.parametrize(
    ('state', 'fault', 'end'), [('standing', '', End()), ('faulted', 'door', End('machine: door'))]
)
def test_second_report_replaces_a_lost_event(before, state, fault, end):
    """A burst of foreign messages may push the FINISHED event of the machine out of a queue."""
    cycle = cycle_in(before)
    assert cycle.reported(101.0, 'standing', 0, '', []) == (), 'a report of the previous cycle'
    assert cycle.reported(101.0, 'running', 1, '', []) == ()
    assert cycle.reported(102.0, state, 1, fault, []) == ()
    assert cycle.reported(103.0, state, 1, fault, []) == (end,)


def looks(cycle, begin, end):
    """Return the actions of a look every second."""
    return [action for second in range(begin, end) for action in cycle.look(float(second), False, HEARD)]


@pytest.mark.parametrize('state', [STARTING, RUNNING])
def test_silent_machine_ends_the_cycle_and_is_named(state):
    cycle = cycle_in(state)
    cycle.look(100.0, False, HEARD)
    cycle.reported(101.0, 'running', 1, '', [])
    assert [action for action in looks(cycle, 101, 114) if action != Send(1)] == []
    stop, end = (action for action in looks(cycle, 114, 116) if action != Send(1))
    assert stop.reason.startswith('the machine gives no sign of life for 13 s')
    assert end.reason == f'cycle 1: {stop.reason}; end it and start it again'


def test_machine_is_not_silent_while_its_reports_are_not_read():
    cycle = cycle_in(RUNNING)
    cycle.reported(101.0, 'running', 1, '', [])
    assert looks(cycle, 200, 205) == [], 'this process was held up for 99 s'


def test_machine_without_reports_is_never_silent():
    """A machine of the user's own need not publish diagnostics."""
    cycle = cycle_in(RUNNING)
    assert looks(cycle, 100, 200) == []
