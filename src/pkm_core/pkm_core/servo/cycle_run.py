"""The life of a motion cycle on the machine, from the first joint that loads it to its end or a fault."""

from enum import Enum
from math import inf

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
from pkm_core.servo.jog_pieces import JogPieces
from pkm_core.servo.next_cycle import NextCycle
from pkm_core.servo.pace import Turn
from pkm_core.servo.recorder_window import RecorderWindow


class CycleState(Enum):
    """State of the machine with respect to motion cycles."""

    STANDING = 'standing'  # no cycle is loaded; initially, after a cycle, a refusal or a reset
    LOADING = 'loading'  # some joints have loaded the next cycle
    LOADED = 'loaded'  # all joints have; the recorder or a reader of the encoders may be missing
    RUNNING = 'running'  # a tick awaits its answers
    HELD = 'held'  # as far ahead of the recorder as allowed; no tick is awaited
    PAUSED = 'paused'  # between two ticks of a cycle; no tick is awaited
    AWAITING = 'awaiting'  # between two ticks of a jog, for its next piece; no tick is awaited
    FAULTED = 'faulted'  # stopped safely; only a reset ends it


# [s, wall] a killed node stays in the graph for 10 s, a user's own for 20 s; a publisher after that is a real one
LEASE = 22.0
# [s, wall] from the last look that found several publishers to the start: the other nodes, above all the recorder,
# forget a killed one a moment before or after the machine does
SETTLED = 1.0
# a larger number of a cycle is not one of a cell that counts from 1: accepting it would end the counting
MOST_CYCLES = 2**31
# [s, wall] chosen: the way of a piece through the cell takes 10 ms; simulated time stands meanwhile, so nothing moves
PIECE_TIMEOUT = 0.5
# one object for all ticks: `advanced` creates none
SEND_SAMPLES = (SendSamples(),)
SEND_EXTENDED = (SendExtended(),)
AWAIT_TURN = (AwaitTurn(),)
_RUNNING = CycleState.RUNNING  # looked up once: access to a member of an Enum takes as long as the rest of `advanced`


class CycleRun:
    """
    State machine of the cycles of one machine.

    Every event is a method; it returns the tuple of actions to perform, in this order. Times are [s, monotonic].

    Parameters
    ----------
    joints : sequence of str
        Names of the joints; a cycle starts when each has loaded it.
    start_timeout : float
        [s] from the first LOADED event of a cycle to its refusal.
    answer_timeout : float
        [s] wait for the recorder in `HELD` before a safe stop.
    pace : Pace
        An attribute too; `paced` follows each of its changes.
    recorder_window : int or None
        [ticks] allowed distance to the last recorded tick; None: no recorder is required.

    Attributes
    ----------
    state : CycleState
    cycle : int
        Number of the last started cycle, 0 before the first one.
    index : int
        Number of ticks of that cycle that have run.
    fault : str
        Reason of the safe stop, '' without a fault.

    """

    def __init__(self, joints, start_timeout, answer_timeout, pace, recorder_window=None):
        self.state = CycleState.STANDING
        self.cycle = 0
        self.index = 0
        self.fault = ''
        self._joints = tuple(joints)
        self._start_timeout = start_timeout
        self._answer_timeout = answer_timeout
        self._recorder = RecorderWindow(recorder_window)
        self._crowded_at = -inf  # time of the last look that found several publishers
        self._next, self._pieces = NextCycle(joints), JogPieces(joints)
        self._samples = 0  # number of ticks after which the last started cycle ends or waits for a piece
        self._sending: tuple = SEND_SAMPLES  # of the next tick that `_release` begins
        self._announced = 0  # the last cycle of a goal
        self._since = 0.0  # begin of LOADING or of HELD
        self._crowded = False  # intruders have been seen since the begin of LOADING
        self.pace = pace
        self._awaits_turn = False  # the current tick is not due yet
        self._set_last_tick()

    @property
    def is_loading(self):
        """Whether a cycle is loaded by some or all joints and has not started."""
        return self.state in (CycleState.LOADING, CycleState.LOADED)

    @property
    def is_running(self):
        """Whether a cycle has started and has not ended."""
        return self.state in (CycleState.RUNNING, CycleState.HELD, CycleState.PAUSED, CycleState.AWAITING)

    def announced(self, cycle):
        """Take the ANNOUNCED event of a goal: no other cycle than `cycle` starts."""
        self._announced = cycle
        return ()

    def loaded(self, joint, cycle, samples, now, hold=0):
        """
        Take the LOADED event of `joint`: it holds `samples` samples of `cycle` and waits before sample `hold`, if any.

        Events of other sources, late events, of a cycle that has been started, and impossible numbers are ignored. A
        cycle that differs from that of earlier joints replaces theirs, unless theirs is the announced one. The cycle
        starts in `look`; a jog is extended there.
        """
        if joint not in self._joints or cycle > MOST_CYCLES:
            return ()
        if self.state is CycleState.FAULTED:
            reason = f'the machine has stopped: {self.fault}; call the service machine/reset first'
            return (Refuse(cycle, reason),)
        if self.is_running and cycle == self.cycle:
            self._pieces.loaded(joint, samples, hold)
        if self.is_running or cycle <= self.cycle:
            return ()
        if cycle != self._next.number:
            if self.is_loading and self._next.number == self._announced:
                return ()
            self._discard()
        if self._next.is_empty:
            self._next.number, self._since, self._crowded = cycle, now, False
        self._next.loaded(joint, samples, hold)
        self.state = CycleState.LOADING if self._next.late else CycleState.LOADED
        return ()

    def look(self, now, tick, unconnected, intruders=''):
        """
        Start a loaded cycle, or end a wait that has taken too long.

        `tick` is the current tick. `unconnected` names the nodes with readers that are not connected yet, and counts in
        `LOADED` only. `intruders` describes topics with several publishers where one is allowed.
        """
        if self.state is CycleState.AWAITING:
            return self._continue(tick, now)
        ready = self.state is CycleState.LOADED and not self._recorder.is_missing and not unconnected
        ready = ready and self._next.number == self._announced
        if intruders:
            self._crowded_at = now
        if ready and not intruders and now - self._crowded_at >= SETTLED:
            return self._start(tick, now)
        if ready and now - self._since <= max(self._start_timeout, LEASE):
            return ()
        if ready and intruders:
            return self._refuse(f'cycle {self._next.number}: {intruders}')
        # a restarted controller is not believed until DDS forgets the killed one, and then its next event must arrive
        self._crowded = self._crowded or bool(intruders)
        patience = max(self._start_timeout, LEASE) if self._crowded else self._start_timeout
        if self.is_loading and now - self._since > patience:
            remark = f'; {intruders}' if intruders else ''
            return self._refuse(f'cycle {self._next.number}: {self._reason_of_delay(unconnected)}{remark}')
        if self.state is CycleState.HELD and now - self._since > self._answer_timeout:
            return self._stop(
                f'{self._where(tick)}: the recorder has not confirmed anything after tick {self._recorder.recorded} '
                f'for {now - self._since:.1f} s; it may lag by {self._recorder.ticks} ticks'
            )
        return ()

    def advanced(self, tick, now, fault=''):
        """Count one tick of the running cycle: `tick` is the current one now, `fault` what the plant reports."""
        if self.state is not _RUNNING:
            raise RuntimeError(f'machine: tick {tick} in state {self.state.value!r}; expected running')
        self.index += 1
        if fault:
            return self._stop(fault)
        if self.index == self._samples:
            if self._pieces.hold:
                self.state, self._since = CycleState.AWAITING, now
                return self._continue(tick, now)
            self.state = CycleState.STANDING
            self.pace.end(tick, now)
            return (Finish(self.cycle, self._samples),)
        if tick > self._last_tick:
            return self._release(tick, now)
        return SEND_SAMPLES

    def _release(self, tick, now):
        """Begin `tick` unless the recorder, a pause or the pace holds it back."""
        self._awaits_turn = False
        if tick > self._recorder.last:
            self.state, self._since = CycleState.HELD, now
            return ()
        turn = self.pace.turn(tick, now)
        self.state = CycleState.PAUSED if turn is Turn.PAUSED else CycleState.RUNNING
        if turn is Turn.LATER:
            self._awaits_turn = True
            return AWAIT_TURN
        if turn is not Turn.NOW:
            return ()
        sending, self._sending = self._sending, SEND_SAMPLES
        return sending

    def _continue(self, tick, now):
        """Extend the jog by the piece that all joints have loaded; after `PIECE_TIMEOUT` drive the rest of the last."""
        extended = self._pieces.extend()
        if not extended and now - self._since <= PIECE_TIMEOUT:
            return ()
        if not extended:
            self._pieces.close()
        self.state, self._samples = CycleState.RUNNING, self._pieces.stop
        if not extended:
            return self._release(tick, now)
        self._sending = SEND_EXTENDED
        return Extend(self.cycle, self._pieces.samples), *self._release(tick, now)

    def turn(self, tick, now):
        """Begin `tick`, which is due; ignored unless it was waited for."""
        return self._release(tick, now) if self._awaits_turn and self.state is _RUNNING else ()

    def paced(self, tick, now):
        """Take a change of the pace, the begin or the end of a pause, or a step."""
        self._set_last_tick()
        return self._release(tick, now) if self._awaits_turn or self.state is CycleState.PAUSED else ()

    def recorded(self, recorded_tick, tick, now):
        """
        Take the report of the recorder that it holds every sample up to `recorded_tick`; `tick` is the current tick.

        The first report discards what is loaded: the recorder may have missed those trajectories. They are resent.
        """
        if self._recorder.recorded < 0:
            self._discard()
        self._recorder.report(recorded_tick)
        self._set_last_tick()
        return self._release(tick, now) if self.state is CycleState.HELD and tick <= self._recorder.last else ()

    def rested(self, rest, tick, now):
        """Note that `rest` ticks have passed while the machine stood: the cycle just started begins with `tick`."""
        self._recorder.rested(rest, tick)
        self._set_last_tick()
        self.pace.begin(tick, now)

    def unanswered(self, tick, waited, missing):
        """Stop a running cycle: for `waited` [s] no answer to `tick` from `missing`, in words."""
        if self.state is not CycleState.RUNNING:
            return ()
        return self._stop(f'{self._where(tick)}: no answer for {waited:.1f} s from {missing}')

    def stop_requested(self, cycle, reason):
        """Take a STOP event; ignored unless `cycle` is running."""
        return self._stop(reason) if self.is_running and cycle == self.cycle else ()

    def halt(self, reason):
        """Take the request to stop now, in any state: a running cycle is braked, no cycle starts before a reset."""
        if self.is_running:
            return self._stop(reason)
        if self.state is not CycleState.FAULTED:
            self._discard()
            self.state, self.fault = CycleState.FAULTED, reason
        return ()

    def reset(self):
        """Take a reset request; refused while a cycle is running."""
        if self.is_running:
            return (RefuseReset(f'cycle {self.cycle} is running; reset is allowed only between cycles'),)
        message = f'at home; cleared: {self.fault}' if self.fault else 'at home; there was no fault'
        self._discard()
        self.state, self.fault = CycleState.STANDING, ''
        return (GoHome(self.cycle, message),)

    def _set_last_tick(self):
        """Set the tick after which `advanced` does more than send samples."""
        self._last_tick = self._recorder.last if self.pace.is_free else -1

    def _start(self, tick, now):
        if self._next.mismatch:
            return self._refuse(self._next.mismatch)
        self._pieces.begin(self._next.samples, self._next.hold)
        self._sending = SEND_SAMPLES
        self.state, self.cycle, self.index, self._samples = _RUNNING, self._next.number, 0, self._pieces.stop
        self.pace.begin(tick, now)
        return Start(self.cycle, self._pieces.samples, self._pieces.hold), *self._release(tick, now)

    def _refuse(self, reason):
        self._discard()
        return (Refuse(self._next.number, reason),)

    def _stop(self, reason):
        self.state, self.fault, self._awaits_turn = CycleState.FAULTED, reason, False
        return (StopSafely(self.cycle, self.index, reason),)

    def _discard(self):
        """Forget what the joints have loaded."""
        self._next.clear()
        if self.is_loading:
            self.state = CycleState.STANDING

    def _reason_of_delay(self, unconnected):
        if self._next.late:
            return f'not loaded within {self._start_timeout} s by joint_controller of {self._next.late}'
        if self._recorder.is_missing:
            return f'the recorder has not reported within {self._start_timeout} s; is it running?'
        if self._next.number != self._announced:
            return 'belongs to no running goal; only the trajectory source of this cell starts cycles'
        return f'topics of {list(unconnected)} have readers that are not connected after {self._start_timeout} s'

    def _where(self, tick):
        return f'tick {tick} (cycle {self.cycle}, sample {self.index})'
