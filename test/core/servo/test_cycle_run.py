"""The cycle on the machine: one table of every event in every state, and random sequences of events."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pkm_core.servo.cycle_actions import (
    AwaitTurn,
    Extend,
    Finish,
    GoHome,
    Refuse,
    RefuseReset,
    SendExtended,
    SendSamples,
    Start,
    StopSafely,
)
from pkm_core.servo.cycle_run import LEASE, MOST_CYCLES, PIECE_TIMEOUT, SETTLED, CycleRun, CycleState
from pkm_core.servo.pace import Pace
from pkm_core.servo.tick_barrier import TickBarrier

STANDING, LOADING, LOADED, RUNNING, HELD, PAUSED, AWAITING, FAULTED = CycleState
JOINTS = ('a', 'b')
START_TIMEOUT, ANSWER_TIMEOUT, WINDOW = 10.0, 5.0, 2
EVENTS = {
    'announced',
    'loaded',
    'look',
    'advanced',
    'recorded',
    'turn',
    'paced',
    'unanswered',
    'stop_requested',
    'halt',
}
EVENTS |= {'reset'}

CYCLE = 4  # of every state but STANDING, which has run cycle 3
REFUSED_BY_FAULT = 'the machine has stopped: a: door; call the service machine/reset first'
RUNS = f'cycle {CYCLE} is running; reset is allowed only between cycles'
NO_FAULT = 'at home; there was no fault'


def run_in(state, *, window=WINDOW, recorded=0, lengths=(5, 5), pace=0.0, paused=False):
    """
    Return a run in `state`, reached by events at 0 s: cycle 3 of one tick has been run, the machine is at tick 1.

    LOADING has cycle 4 from joint a. RUNNING and HELD have advanced to tick 2 and 4 (the window is 2 ticks), PAUSED to
    tick 3. AWAITING waits at tick 2, before sample 1, for the next piece. `pace` and `paused` are set at the end; a
    tick takes 1 s.
    """
    timing = Pace(1.0)
    run = CycleRun(JOINTS, START_TIMEOUT, ANSWER_TIMEOUT, timing, window)
    if recorded is not None:
        run.recorded(recorded, 0, 0.0)
        load(run, 3, (1, 1))
        run.look(0.0, 0, [])
        run.advanced(1, 0.0)
    if state is LOADING:
        run.loaded('a', CYCLE, lengths[0], 0.0)
    elif state is not STANDING:
        load(run, CYCLE, lengths, hold=1 if state is AWAITING else 0)
    if state in (RUNNING, HELD, PAUSED, AWAITING, FAULTED):
        run.look(0.0, 1, [])
        run.advanced(2, 0.0)
    if state is HELD:
        run.recorded(1, 2, 0.0)
        run.advanced(3, 0.0)
        run.advanced(4, 0.0)
    if state is PAUSED:
        timing.pause(2, 0.0)
        run.paced(2, 0.0)
        run.recorded(1, 2, 0.0)
        run.advanced(3, 0.0)
    if state is FAULTED:
        run.stop_requested(CYCLE, 'a: door')
    assert run.state is state
    if pace:
        timing.set(pace, 2, 0.0)
        run.paced(2, 0.0)
    if paused:
        timing.pause(2, 0.0)
        run.paced(2, 0.0)
    return run


def load(run, cycle, lengths, hold=0):
    run.announced(cycle)
    for joint, samples in zip(JOINTS, lengths, strict=True):
        run.loaded(joint, cycle, samples, 0.0, hold)


def row(state, event, after, *actions, **options):
    return pytest.param(state, event, after, actions, options, id=f'{state.value}-{event}-{options or ""}')


TABLE = [
    # a goal announces a cycle
    *(row(state, ('announced', 5), state) for state in CycleState),
    # a joint has loaded a cycle
    row(STANDING, ('loaded', 'a', 4, 5, 0.0), LOADING),
    row(STANDING, ('loaded', 'x', 4, 5, 0.0), STANDING),  # not a joint
    row(STANDING, ('loaded', 'a', 3, 5, 0.0), STANDING),  # late
    row(LOADING, ('loaded', 'a', 4, 6, 0.0), LOADING),
    row(LOADING, ('loaded', 'b', 4, 5, 0.0), LOADED),
    row(LOADING, ('loaded', 'b', 5, 5, 0.0), LOADING),  # replaces cycle 4 of joint a
    row(LOADING, ('loaded', 'b', 3, 5, 0.0), LOADING),
    row(LOADED, ('loaded', 'b', 4, 5, 0.0), LOADED),
    row(LOADED, ('loaded', 'b', 5, 5, 0.0), LOADED),  # cycle 4 is the announced one
    row(STANDING, ('loaded', 'a', MOST_CYCLES + 1, 5, 0.0), STANDING),
    row(RUNNING, ('loaded', 'a', 5, 5, 0.0), RUNNING),
    row(HELD, ('loaded', 'a', 5, 5, 0.0), HELD),
    row(PAUSED, ('loaded', 'a', 5, 5, 0.0), PAUSED),
    row(AWAITING, ('loaded', 'a', 5, 5, 0.0), AWAITING),
    row(AWAITING, ('loaded', 'a', 4, 8, 0.0, 4), AWAITING),  # a piece; it is used in `look`, when all joints have it
    row(FAULTED, ('loaded', 'a', 5, 5, 0.0), FAULTED, Refuse(5, REFUSED_BY_FAULT)),
    row(FAULTED, ('loaded', 'x', 5, 5, 0.0), FAULTED),
    # look: start, or end a wait
    row(STANDING, ('look', 1e9, 1, []), STANDING),
    row(LOADING, ('look', 10.0, 1, []), LOADING),
    row(
        LOADING,
        ('look', 10.1, 1, []),
        STANDING,
        Refuse(4, "cycle 4: not loaded within 10.0 s by joint_controller of ['b']"),
    ),
    row(LOADED, ('look', 0.0, 1, []), RUNNING, Start(4, 5), SendSamples()),
    row(LOADED, ('look', 1e9, 1, []), RUNNING, Start(4, 5), SendSamples()),  # complete: no timeout
    row(LOADED, ('look', 0.0, 1, []), RUNNING, Start(4, 5), SendSamples(), window=None, recorded=None),
    row(LOADED, ('look', LEASE, 1, [], 'two at /a'), LOADED),  # a killed node may still be in the graph
    row(LOADED, ('look', LEASE + 0.1, 1, [], 'two at /a'), STANDING, Refuse(4, 'cycle 4: two at /a')),
    row(LOADING, ('look', LEASE, 1, [], 'two at /a'), LOADING),
    row(
        LOADING,
        ('look', LEASE + 0.1, 1, [], 'two at /a'),
        STANDING,
        Refuse(4, "cycle 4: not loaded within 10.0 s by joint_controller of ['b']; two at /a"),
    ),
    row(LOADED, ('look', 10.0, 1, ['laser']), LOADED),
    row(
        LOADED,
        ('look', 10.1, 1, ['laser']),
        STANDING,
        Refuse(4, "cycle 4: topics of ['laser'] have readers that are not connected after 10.0 s"),
    ),
    row(LOADED, ('look', 10.0, 1, []), LOADED, recorded=None),
    row(
        LOADED,
        ('look', 10.1, 1, []),
        STANDING,
        Refuse(4, 'cycle 4: the recorder has not reported within 10.0 s; is it running?'),
        recorded=None,
    ),
    row(
        LOADED,
        ('look', 0.0, 1, []),
        STANDING,
        Refuse(4, "the joints loaded cycles of different lengths: {'a': 5, 'b': 6}; all must be equal and at least 1"),
        lengths=(5, 6),
    ),
    row(
        LOADED,
        ('look', 0.0, 1, []),
        STANDING,
        Refuse(4, "the joints loaded cycles of different lengths: {'a': 0, 'b': 0}; all must be equal and at least 1"),
        lengths=(0, 0),
    ),
    row(RUNNING, ('look', 1e9, 2, []), RUNNING),  # the barrier has the timeout of the answers
    row(HELD, ('look', 5.0, 4, []), HELD),
    row(
        HELD,
        ('look', 5.1, 4, []),
        FAULTED,
        StopSafely(
            4,
            3,
            'tick 4 (cycle 4, sample 3): the recorder has not confirmed anything after tick 1 for 5.1 s; '
            'it may lag by 2 ticks',
        ),
    ),
    row(PAUSED, ('look', 1e9, 3, []), PAUSED),  # a pause has no timeout
    row(LOADED, ('look', 0.0, 1, []), PAUSED, Start(4, 5), paused=True),
    row(LOADED, ('look', 0.0, 1, []), RUNNING, Start(4, 5), SendSamples(), pace=1.0),
    row(AWAITING, ('look', PIECE_TIMEOUT, 2, []), AWAITING),
    row(AWAITING, ('look', PIECE_TIMEOUT + 0.1, 2, []), RUNNING, SendSamples()),  # the rest of the last piece
    row(FAULTED, ('look', 1e9, 2, []), FAULTED),
    # the mechanism has advanced by one tick; in other states: test_tick_outside_a_running_cycle_is_an_error
    row(RUNNING, ('advanced', 2, 0.0), RUNNING, SendSamples()),
    row(RUNNING, ('advanced', 3, 0.0), HELD),
    row(RUNNING, ('advanced', 1000, 0.0), RUNNING, SendSamples(), window=None),
    row(RUNNING, ('advanced', 3, 0.0), STANDING, Finish(4, 2), lengths=(2, 2)),
    row(RUNNING, ('advanced', 2, 0.0, 'stop d1'), FAULTED, StopSafely(4, 2, 'stop d1')),
    row(RUNNING, ('advanced', 2, 0.0, 'stop d1'), FAULTED, StopSafely(4, 2, 'stop d1'), lengths=(2, 2)),
    row(RUNNING, ('advanced', 2, 0.0), PAUSED, paused=True),
    row(RUNNING, ('advanced', 3, 0.9), RUNNING, AwaitTurn(), pace=1.0, window=None),
    row(RUNNING, ('advanced', 3, 1.0), RUNNING, SendSamples(), pace=1.0, window=None),
    row(RUNNING, ('advanced', 3, 0.9), HELD, pace=1.0),  # the recorder comes first
    row(RUNNING, ('advanced', 3, 0.9), STANDING, Finish(4, 2), lengths=(2, 2), pace=1.0),
    # the current tick is due
    *(row(state, ('turn', 3, 1e9), state) for state in CycleState),  # none was waited for
    # the pace has changed
    *(row(state, ('paced', 2, 0.0), state) for state in CycleState),
    # the recorder reports
    row(STANDING, ('recorded', 1, 1, 0.0), STANDING),
    row(LOADING, ('recorded', 1, 1, 0.0), LOADING),
    row(LOADING, ('recorded', 0, 1, 0.0), STANDING, recorded=None),  # first report: trajectories are resent
    row(LOADED, ('recorded', 1, 1, 0.0), LOADED),
    row(LOADED, ('recorded', 0, 1, 0.0), STANDING, recorded=None),
    row(LOADED, ('recorded', 0, 1, 0.0), STANDING, recorded=None, window=None),
    row(RUNNING, ('recorded', 1, 2, 0.0), RUNNING),
    row(HELD, ('recorded', 1, 4, 0.0), HELD),
    row(HELD, ('recorded', 2, 4, 0.0), RUNNING, SendSamples()),
    row(PAUSED, ('recorded', 2, 3, 0.0), PAUSED),
    row(AWAITING, ('recorded', 1, 2, 0.0), AWAITING),
    row(FAULTED, ('recorded', 2, 4, 0.0), FAULTED),
    # answers are overdue
    row(
        RUNNING,
        ('unanswered', 2, 5.04, 'd1, d3'),
        FAULTED,
        StopSafely(4, 1, 'tick 2 (cycle 4, sample 1): no answer for 5.0 s from d1, d3'),
    ),
    *(row(state, ('unanswered', 2, 5.04, 'd1'), state) for state in CycleState if state is not RUNNING),
    # a STOP event
    row(RUNNING, ('stop_requested', 4, 'a: door'), FAULTED, StopSafely(4, 1, 'a: door')),
    row(HELD, ('stop_requested', 4, 'a: door'), FAULTED, StopSafely(4, 3, 'a: door')),
    row(PAUSED, ('stop_requested', 4, 'a: door'), FAULTED, StopSafely(4, 2, 'a: door')),
    row(AWAITING, ('stop_requested', 4, 'a: door'), FAULTED, StopSafely(4, 1, 'a: door')),
    row(RUNNING, ('stop_requested', 3, 'a: door'), RUNNING),
    row(HELD, ('stop_requested', 5, 'a: door'), HELD),
    row(STANDING, ('stop_requested', 3, 'a: door'), STANDING),
    row(LOADING, ('stop_requested', 4, 'a: door'), LOADING),
    row(LOADED, ('stop_requested', 4, 'a: door'), LOADED),
    row(FAULTED, ('stop_requested', 4, 'b: window'), FAULTED),
    # a request to stop now: nothing starts before a reset, even between cycles
    row(STANDING, ('halt', 'hand'), FAULTED),
    row(LOADING, ('halt', 'hand'), FAULTED),
    row(LOADED, ('halt', 'hand'), FAULTED),
    row(RUNNING, ('halt', 'hand'), FAULTED, StopSafely(4, 1, 'hand')),
    row(HELD, ('halt', 'hand'), FAULTED, StopSafely(4, 3, 'hand')),
    row(PAUSED, ('halt', 'hand'), FAULTED, StopSafely(4, 2, 'hand')),
    row(AWAITING, ('halt', 'hand'), FAULTED, StopSafely(4, 1, 'hand')),
    row(FAULTED, ('halt', 'hand'), FAULTED),
    # a reset request
    row(STANDING, ('reset',), STANDING, GoHome(3, NO_FAULT)),
    row(LOADING, ('reset',), STANDING, GoHome(3, NO_FAULT)),
    row(LOADED, ('reset',), STANDING, GoHome(3, NO_FAULT)),
    row(RUNNING, ('reset',), RUNNING, RefuseReset(RUNS)),
    row(HELD, ('reset',), HELD, RefuseReset(RUNS)),
    row(PAUSED, ('reset',), PAUSED, RefuseReset(RUNS)),
    row(AWAITING, ('reset',), AWAITING, RefuseReset(RUNS)),
    row(FAULTED, ('reset',), STANDING, GoHome(4, 'at home; cleared: a: door')),
]


@pytest.mark.parametrize(('state', 'event', 'after', 'actions', 'options'), TABLE)
def test_event_in_state(state, event, after, actions, options):
    run = run_in(state, **options)
    name, *arguments = event
    assert getattr(run, name)(*arguments) == actions
    assert run.state is after


def test_table_has_every_event_in_every_state():
    covered = {(param.values[0], param.values[1][0]) for param in TABLE}
    states = {(state, event) for state in CycleState for event in EVENTS}
    assert states - covered == {(state, 'advanced') for state in CycleState if state is not RUNNING}


@pytest.mark.parametrize('state', [state for state in CycleState if state is not RUNNING])
def test_tick_outside_a_running_cycle_is_an_error(state):
    run = run_in(state)
    with pytest.raises(RuntimeError, match=f"tick 9 in state '{state.value}'; expected running"):
        run.advanced(9, 0.0)
    assert run.state is state


def test_first_joint_of_a_replaced_cycle_loads_again():
    run = run_in(LOADING)
    run.announced(5)
    run.loaded('b', 5, 5, 8.0)
    assert run.look(17.9, 1, []) == ()  # the timeout counts from the new cycle
    run.loaded('a', 5, 5, 18.0)
    assert run.look(18.0, 1, []) == (Start(5, 5), SendSamples())


def test_cycle_without_a_goal_does_not_start():
    """A trajectory of any publisher makes controllers load a cycle; only the trajectory source announces one."""
    run = run_in(LOADED)
    run.announced(5)
    assert run.look(10.0, 1, []) == ()
    (refusal,) = run.look(10.1, 1, [])
    assert refusal.reason.startswith('cycle 4: belongs to no running goal')


@pytest.mark.parametrize('discard', [CycleRun.reset, lambda run: run.recorded(0, 1, 0.0)])
def test_discarded_cycle_is_loaded_again_by_all_joints(discard):
    run = run_in(LOADING, recorded=None)
    discard(run)
    run.loaded('b', CYCLE, 5, 0.0)
    assert run.state is LOADING
    run.loaded('a', CYCLE, 5, 0.0)
    assert run.state is LOADED


def test_fault_is_kept_until_reset():
    run = run_in(FAULTED)
    assert run.fault == 'a: door'
    run.reset()
    assert run.fault == ''
    load(run, 5, (5, 5))
    assert run.look(0.0, 2, []) == (Start(5, 5), SendSamples())
    assert (run.cycle, run.index) == (5, 0)


RANDOM_EVENTS = st.one_of(
    # cycles relative to the last one
    st.tuples(
        st.just('loaded'), st.sampled_from('aabbx'), st.sampled_from([0, 1, 1, 1, 2]), st.sampled_from([3, 3, 3, 0])
    ),
    st.tuples(st.just('look'), st.sampled_from([[], [], ['laser']])),
    st.tuples(st.just('answer'), st.integers(0, 1), st.integers(-1, 1), st.sampled_from([0.5, 0.5, float('nan')])),
    st.tuples(st.just('announced'), st.sampled_from([0, 1, 2])),
    st.tuples(st.just('load all')),
    st.tuples(st.just('load jog')),
    st.tuples(st.just('load piece'), st.sampled_from([1, 1, 2])),
    st.tuples(st.just('piece'), st.sampled_from('ab'), st.integers(0, 4), st.integers(0, 4)),
    st.tuples(st.just('answer all')),
    st.tuples(st.just('answer all')),
    st.tuples(st.just('recorded')),
    st.tuples(st.just('watch')),
    st.tuples(st.just('wait'), st.sampled_from([1.0, 6.0])),
    st.tuples(st.just('pace'), st.sampled_from([0.0, 0.5, 2.0])),
    st.tuples(st.sampled_from(['pause', 'resume', 'step', 'turn'])),
    st.tuples(st.just('stop_requested'), st.integers(-1, 0)),
    st.tuples(st.just('halt')),
    st.tuples(st.just('reset')),
)


class Shell:
    """What the machine's node does with barrier and run, on an imagined mechanism."""

    def __init__(self, window):
        self.barrier = TickBarrier(len(JOINTS), ANSWER_TIMEOUT)
        self.pace = Pace(1.0)
        self.run = CycleRun(JOINTS, START_TIMEOUT, ANSWER_TIMEOUT, self.pace, window)
        self.now = 0.0
        self.waits = False  # for the time of the current tick
        self.answered = set()  # joints with a finite answer to the current tick
        self.announced = 0
        self.ended = []  # cycles that finished or were stopped

    def feed(self, event):
        match event:
            case ('load all',):  # in a row, so that long sequences get beyond LOADING
                steps = [('announced', 1), ('loaded', 'a', 1, 3), ('loaded', 'b', 1, 3), ('look', [])]
            case ('load jog',):
                steps = [('announced', 1), ('loaded', 'a', 1, 3, 1), ('loaded', 'b', 1, 3, 1), ('look', [])]
            case ('load piece', hold):
                steps = [('piece', 'a', hold + 2, hold), ('piece', 'b', hold + 2, hold), ('look', [])]
            case ('answer all',):
                steps = [('answer', 0, 0, 0.5), ('answer', 1, 0, 0.5)]
            case _:
                steps = [event]
        for step in steps:
            self.feed_one(*step)

    def feed_one(self, name, *arguments):
        run, barrier, tick = self.run, self.barrier, self.barrier.tick
        before, index = run.state, run.index
        match name:
            case 'wait':
                self.now += arguments[0]
            case 'announced':
                self.announced = run.cycle + arguments[0]
                self.perform(run.announced(self.announced))
            case 'loaded':
                joint, shift, samples, *hold = arguments
                self.perform(run.loaded(joint, run.cycle + shift, samples, self.now, *hold))
            case 'piece':
                joint, samples, hold = arguments
                self.perform(run.loaded(joint, run.cycle, run.index + samples, self.now, run.index + hold))
            case 'look':
                self.perform(run.look(self.now, tick, *arguments))
            case 'answer':
                self.answer(*arguments)
            case 'recorded':
                self.perform(run.recorded(tick, tick, self.now))
            case 'pace':
                self.pace.set(*arguments, tick, self.now)
                self.perform(run.paced(tick, self.now))
            case 'pause' | 'resume':
                getattr(self.pace, name)(tick, self.now)
                self.perform(run.paced(tick, self.now))
            case 'step' if self.pace.paused and run.is_running:
                self.pace.step()
                self.perform(run.paced(tick, self.now))
            case 'turn':
                self.perform(run.turn(tick, self.now))
            case 'watch' if missing := barrier.overdue(self.now):
                self.perform(run.unanswered(tick, barrier.waited(self.now), missing))
                assert run.state is FAULTED
            case 'stop_requested':
                self.perform(run.stop_requested(run.cycle + arguments[0], 'door'))
            case 'halt':
                self.perform(run.halt('hand'))
                assert run.state is FAULTED
            case 'reset':
                self.perform(run.reset())
        self.check(name, before, index)

    def answer(self, joint, shift, voltage):
        barrier = self.barrier
        if barrier.is_open and shift == 0 and voltage == voltage:
            self.answered.add(joint)
        if barrier.answer(joint, barrier.tick + shift, voltage):
            assert self.answered == {0, 1}
            self.answered.clear()
            self.perform(self.run.advanced(barrier.next_tick(), self.now))

    def perform(self, actions):
        run = self.run
        for action in actions:
            match action:
                case Extend(cycle, samples):
                    assert cycle == run.cycle not in self.ended
                    assert samples > run.index
                case SendSamples() | SendExtended():
                    assert not self.barrier.is_open
                    self.barrier.open(self.now)
                    self.waits = False
                    self.answered.clear()
                case AwaitTurn():
                    assert self.pace.due(self.barrier.tick) > self.now
                    self.waits = True
                case Start(cycle, samples):
                    assert samples > 0
                    assert cycle == self.announced
                    assert cycle > max(self.ended, default=0)
                case Finish(cycle) | StopSafely(cycle):
                    self.ended.append(cycle)
                    self.barrier.close()
                    self.answered.clear()

    def check(self, name, before, index):
        run = self.run
        self.waits = self.waits and run.state is RUNNING
        assert self.barrier.is_open == (run.state is RUNNING and not self.waits)
        assert run.state is not PAUSED or self.pace.paused
        assert bool(run.fault) == (run.state is FAULTED)
        if before is FAULTED:
            assert run.state is FAULTED or name == 'reset'
        if name not in ('answer', 'look'):
            assert run.index == index


@given(window=st.sampled_from([None, 1]), events=st.lists(RANDOM_EVENTS, min_size=30, max_size=80))
def test_random_events_keep_barrier_and_run_consistent(window, events):
    """
    Ticks need every answer, a fault ends by reset only, no cycle starts twice.

    The barrier is open exactly while the run awaits answers. Pauses, steps and changes of the pace come at any time.
    """
    shell = Shell(window)
    for event in events:
        shell.feed(event)
    assert shell.ended == sorted(set(shell.ended))


@pytest.mark.parametrize(('holds', 'hold'), [((1, 1), 1), ((1, 0), 0), ((1, 2), 0), ((4, 4), 0), ((9, 9), 0)])
def test_cycle_is_a_jog_if_all_joints_hold_within_it(holds, hold):
    """A controller that takes no pieces reports no hold: then the machine waits for none."""
    run = run_in(STANDING, window=None)
    run.announced(CYCLE)
    for joint, own in zip(JOINTS, holds, strict=True):
        run.loaded(joint, CYCLE, 4, 0.0, own)
    assert run.look(0.0, 1, []) == (Start(CYCLE, 4, hold), SendSamples())


def jogging(window=None):
    """Return a run that has sent the last tick before its hold: 4 samples, held before sample 1."""
    run = run_in(STANDING, window=window)
    load(run, CYCLE, (4, 4), hold=1)
    run.look(0.0, 1, [])
    return run


def load_piece(run, samples, hold, joints=JOINTS):
    for joint in joints:
        run.loaded(joint, CYCLE, samples, 0.0, hold)


def test_piece_that_is_loaded_in_time_extends_the_cycle_at_once():
    run = jogging()
    load_piece(run, 5, 2)
    assert run.advanced(2, 0.0) == (Extend(CYCLE, 5), SendExtended())
    load_piece(run, 6, 3)
    assert run.advanced(3, 0.0) == (Extend(CYCLE, 6), SendExtended())
    assert (run.advanced(4, 0.0), run.state) == ((), AWAITING)


def test_piece_that_the_machine_waits_for_extends_the_cycle():
    run = jogging()
    assert (run.advanced(2, 0.0), run.state) == ((), AWAITING)
    load_piece(run, 5, 2, 'a')
    assert run.look(0.1, 2, []) == ()
    load_piece(run, 5, 2, 'b')
    assert run.look(0.2, 2, []) == (Extend(CYCLE, 5), SendExtended())


def test_jog_without_a_further_piece_is_driven_to_its_end():
    """A killed trajectory source: the machine drives the end at rest that every piece has, and takes no piece then."""
    run = jogging()
    run.advanced(2, 0.0)
    assert run.look(PIECE_TIMEOUT + 0.1, 2, []) == (SendSamples(),)
    load_piece(run, 9, 3)
    assert run.advanced(3, 1.0) == run.advanced(4, 1.0) == (SendSamples(),)
    assert run.advanced(5, 1.0) == (Finish(CYCLE, 4),)


@pytest.mark.parametrize(('samples', 'hold'), [(4, 2), (5, 1), (5, 5), (5, 6)])
def test_piece_that_extends_nothing_is_ignored(samples, hold):
    """Not longer than the cycle, or with a hold before its own begin or after its end."""
    run = jogging()
    load_piece(run, samples, hold)
    assert (run.advanced(2, 0.0), run.state) == ((), AWAITING)
    load_piece(run, 7, 0)
    assert run.look(0.1, 2, []) == (Extend(CYCLE, 7), SendExtended())


def test_different_pieces_of_two_joints_are_not_used():
    run = jogging()
    load_piece(run, 5, 2, 'a')
    load_piece(run, 6, 2, 'b')
    assert (run.advanced(2, 0.0), run.state) == ((), AWAITING)


def test_recorder_and_pace_hold_the_first_tick_of_a_piece():
    run = jogging(window=1)
    load_piece(run, 5, 2)
    assert (run.advanced(2, 0.0), run.state) == ((Extend(CYCLE, 5),), HELD)
    assert run.recorded(1, 2, 0.0) == (SendExtended(),)
    run = jogging()
    run.pace.set(1.0, 1, 0.0)
    run.paced(1, 0.0)
    load_piece(run, 5, 2)
    assert run.advanced(2, 0.1) == (Extend(CYCLE, 5), AwaitTurn())
    assert run.turn(2, 1.0) == (SendExtended(),)


def test_cycle_that_is_no_jog_cannot_be_extended():
    run = run_in(RUNNING, window=None, lengths=(2, 2))
    load_piece(run, 9, 5)
    assert run.advanced(3, 0.0) == (Finish(CYCLE, 2),)


def test_restarted_joint_has_time_after_the_killed_one_has_left():
    """Its next LOADED event comes up to a second later: the wait does not end the moment the graph is clear."""
    run = run_in(LOADING)
    run.announced(CYCLE)
    assert run.look(1.0, 1, [], 'two at /b') == ()
    assert run.look(START_TIMEOUT + 1.0, 1, []) == ()
    run.loaded('b', CYCLE, 5, START_TIMEOUT + 1.5)
    assert run.look(START_TIMEOUT + 1.5, 1, []) == (Start(CYCLE, 5), SendSamples())
    again = run_in(LOADING)
    again.look(1.0, 1, [], 'two at /b')
    assert isinstance(again.look(LEASE + 1.0, 1, [])[0], Refuse)


def test_cycle_starts_once_the_other_nodes_forgot_a_killed_one():
    """The recorder may forget a killed controller later, and would drop the first commands of the next."""
    run = run_in(LOADED)
    assert run.look(1.0, 1, [], 'two at /b') == ()
    assert run.look(1.0 + SETTLED - 0.01, 1, []) == ()
    assert run.look(1.0 + SETTLED, 1, []) == (Start(CYCLE, 5), SendSamples())


def test_paced_tick_begins_at_its_time_and_no_sooner():
    run = run_in(RUNNING, window=None, pace=0.5)  # tick 2 at 0 s, then every 2 s
    assert run.advanced(3, 0.1) == (AwaitTurn(),)
    assert run.turn(3, 1.9) == (AwaitTurn(),)  # an early alarm
    assert run.turn(3, 2.0) == (SendSamples(),)
    assert run.turn(3, 2.0) == ()  # a second one


def test_change_of_the_pace_moves_the_tick_that_waits():
    run = run_in(RUNNING, window=None, pace=0.01)
    assert run.advanced(3, 0.1) == (AwaitTurn(),)
    run.pace.set(0.0, 3, 0.2)
    assert run.paced(3, 0.2) == (SendSamples(),)


def test_pause_takes_the_tick_that_waits_and_gives_it_back():
    run = run_in(RUNNING, window=None, pace=0.5)
    run.advanced(3, 0.1)
    run.pace.pause(3, 0.2)
    assert (run.paced(3, 0.2), run.state) == ((), PAUSED)
    assert run.turn(3, 2.0) == ()  # the alarm of before
    run.pace.resume(3, 50.0)
    assert (run.paced(3, 50.0), run.state) == ((SendSamples(),), RUNNING)
    assert run.advanced(4, 50.1) == (AwaitTurn(),)  # the ticks of the pause are not made up for


def test_step_runs_one_tick_and_pauses_again():
    run = run_in(PAUSED, window=None)
    run.pace.step()
    assert run.paced(3, 1.0) == (SendSamples(),)
    assert (run.advanced(4, 1.0), run.state) == ((), PAUSED)


def test_last_step_finishes_the_cycle():
    run = run_in(PAUSED, window=None, lengths=(3, 3))
    run.pace.step()
    run.paced(3, 1.0)
    assert (run.advanced(4, 1.0), run.state) == ((Finish(4, 3),), STANDING)


def test_rest_before_a_cycle_does_not_hold_it():
    """The recorder has recorded tick 0 of cycle 3; cycle 4 begins 200 ticks later, within a window of 2 ticks."""
    run = run_in(LOADED)
    run.recorded(0, 1, 0.0)
    run.look(0.0, 1, [])
    run.rested(200, 201, 0.0)
    assert run.advanced(202, 0.0) == (SendSamples(),)
    run.recorded(0, 202, 0.0)  # sent before the first sample arrived
    assert run.advanced(203, 0.0) == ()
    assert run.recorded(201, 203, 0.0) == (SendSamples(),)
