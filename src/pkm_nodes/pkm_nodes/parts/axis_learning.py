"""Learning of one joint in its controller: the feedforward, its monitor, and the requests to the learning service."""

from array import array

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.control.robust import RobustGains
from pkm_core.errors import PkmError
from pkm_core.learning.monitor import LEARNED, Monitor
from pkm_interfaces.msg import CycleEvent
from pkm_interfaces.msg import RobustGains as RobustGainsMessage
from pkm_interfaces.srv import UpdateFeedforward
from pkm_nodes.parts.gain_parameters import gains_to_msg
from pkm_nodes.runtime.session import belongs

# [s, wall] wait for the learning service, less than that of the machine; after it the next cycle is refused
LEARNING_TIMEOUT = 9.0


class AxisLearning:
    """
    The feedforward of one joint from cycle to cycle.

    Parameters
    ----------
    node : PkmNode
    joint : str
    machine : Machine
        For its sample time and its voltage limit.
    events : CycleEvents
        Of the joint.
    on_end : callable
        Called without arguments when an answer has been taken or refused.

    Attributes
    ----------
    feedforward : ndarray, shape (N,)
        [V] learned, for the next cycle.
    notice : str
        Last observation on the present motion, '' without one.

    """

    def __init__(self, node, joint, machine, events, on_end):
        self.feedforward, self.notice = np.zeros(0), ''
        self._joint, self._events, self._on_end = joint, events, on_end
        self._sample_time, self._limit = machine.sample_time, machine.voltage_limit
        self._logger, self._session = node.get_logger(), node.session
        self._service = node.create_client(UpdateFeedforward, 'learning/update')
        self._wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._cycle = 0  # the last one that was learned from
        self._call = None  # Future of the running request
        self._asked_by = None  # monitor at the time of that request
        self._until, self._silent = 0, False  # deadline of that request, and whether it has passed without an answer
        self._learned_for = None  # (motion, law, reference) the feedforward belongs to
        self._is_one_off = False  # whether the loaded cycle does not repeat
        self._starts = True  # whether the next cycle starts after power-up or a safe stop
        self.renew()

    def renew(self, updates=0):
        """Restart the monitor with the current feedforward, which has had `updates` updates: the loop has changed."""
        self._monitor, self._iteration = Monitor(self._joint, updates), updates

    def reset(self):
        """Note that the next cycle starts from rest; nothing is learned from it, because its friction differs."""
        self._starts = True

    def begin(self, message, reference, given, *, forces):
        """
        Prepare for the cycle of a joint_trajectory message.

        The feedforward is kept if motion, law and planned reference are those of the previous cycle and no feedforward
        is `given` (N,) [V]. Otherwise it is `given`, or zero. The planned reference is `reference` (N,) [m], unless the
        message has the digest of another one, of which `reference` is a correction. Nothing is learned from the first
        cycle under a `given` feedforward, from a cycle after a safe stop or, if the model has `forces`, after power-up:
        their friction is that of another start.
        """
        learned_for = (message.motion, message.learning_law, message.planned or reference.tobytes())
        if learned_for != self._learned_for or given is not None:
            self._learned_for = learned_for
            self.feedforward = np.zeros(len(reference)) if given is None else given
            self.notice = ''
            self.renew(0 if given is None else LEARNED)
        self._is_one_off = given is not None or (self._starts and (forces or bool(self.feedforward.any())))
        self._starts = False

    def is_under_way(self):
        """Return whether an answer is due, for at most `LEARNING_TIMEOUT`."""
        if self._call is not None and self._wall.now().nanoseconds > self._until:
            self._call, self._silent = None, True
        return self._call is not None

    def refuse_silence(self):
        """
        Raise `PkmError`, once, if the last request got no answer in time.

        The next goal begins with the previous feedforward. A goal that continued would end with figures that depend on
        the time that learning took.
        """
        if self._silent:
            self._silent = False
            raise PkmError(
                f'{self._joint}: no answer from {self._service.srv_name} to cycle {self._cycle} for '
                f'{LEARNING_TIMEOUT:g} s: its node learning has ended, is stopped or stuck'
            )

    def learn(self, message, error, gains):
        """Pass `error` (N,) [m] of the cycle of a joint_trajectory to the monitor and request the next feedforward."""
        if self._is_one_off:
            return
        decision = self._monitor.observe(error, self.feedforward)
        self.feedforward = decision.feedforward
        # the monitor counts cycles since learning started; a failed update does not count
        self._iteration = min(self._iteration, decision.iteration)
        self._cycle = message.cycle
        if decision.message:
            self.publish_notice(message.cycle, decision.message)
        if not decision.learn:
            return
        request = UpdateFeedforward.Request(
            session=self._session,
            joint=self._joint,
            law=message.learning_law,
            motion=message.motion,
            cycle=message.cycle,
            iteration=self._iteration,
            sample_time=self._sample_time,
            has_gains=isinstance(gains, RobustGains),  # an observer law is that of the configuration
            gains=gains_to_msg(gains) if isinstance(gains, RobustGains) else RobustGainsMessage(),
            error=array('d', error.tobytes()),
            feedforward=array('d', self.feedforward.tobytes()),
        )
        self._asked_by = self._monitor
        self._call = self._service.call_async(request)
        self._until = self._wall.now().nanoseconds + int(LEARNING_TIMEOUT * 1e9)
        self._call.add_done_callback(self._on_answer)

    def _on_answer(self, future):
        if future is not self._call:
            return
        self._call = None
        response, samples = future.result(), len(self.feedforward)
        feedforward = np.array(response.feedforward)
        refusal = '' if response.success else f'learning refused: {response.message}'
        if not belongs(response.session, self._session):
            refusal = f'learning of session {response.session!r} answered; this cell has session {self._session!r}'
        elif response.success and (len(feedforward) != samples or not np.isfinite(feedforward).all()):
            refusal = f'learning answered {feedforward} ({len(feedforward)} values); expected {samples} finite ones'
        elif response.success and (peak := np.abs(feedforward).max()) > self._limit:
            refusal = f'learning answered up to {peak:g} V; allowed: at most {self._limit:g} V'
        if refusal:
            self._keep(refusal)
        else:
            self.feedforward = feedforward
            self._iteration += self._asked_by is self._monitor  # not if learning was restarted meanwhile
        self._on_end()

    def _keep(self, reason):
        self.publish_notice(self._cycle, f'{self._joint}: {reason}; the previous feedforward is kept')

    def publish_notice(self, cycle, notice):
        """Publish an observation on `cycle` as a NOTICE, in the log and in the diagnostics."""
        self.notice = notice
        self._logger.warning(notice)
        self._events.publish(CycleEvent.NOTICE, cycle, message=notice)
