"""What a controller does for one joint to learn: its feedforward, the watch over it, and the calls to `learning`."""

from array import array

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.learning.monitor import Monitor
from pkm_interfaces.msg import CycleEvent
from pkm_interfaces.srv import UpdateFeedforward
from pkm_nodes.parts.gain_parameters import gains_to_msg

# [s, wall] how long a cycle waits for the learning service before it goes on with the feedforward it has
LEARNING_TIMEOUT = 5.0


class AxisLearning:
    """
    The feedforward of one joint from cycle to cycle.

    Parameters
    ----------
    node : PkmNode
    joint : str
    sample_time : float
        [s]
    events : CycleEvents
        Of the joint.
    on_end : callable
        Called when learning has come to an end, one way or the other.

    Attributes
    ----------
    feedforward : ndarray, shape (N,)
        [V] learned, for the cycle to come.
    notice : str
        What the watch has noticed last of the motion that is learned, '' if nothing.

    """

    def __init__(self, node, joint, sample_time, events, on_end):
        self.feedforward, self.notice = np.zeros(0), ''
        self._joint, self._sample_time, self._events, self._on_end = joint, sample_time, events, on_end
        self._logger = node.get_logger()
        self._service = node.create_client(UpdateFeedforward, 'learning/update')
        self._wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._cycle = 0  # that was learned from last
        self._call = None  # under way
        self._asked_by = None  # the monitor at that time
        self._until = 0
        self._learned_for = None  # (motion, law, reference) the feedforward belongs to
        self.renew()

    def renew(self):
        """Watch and learn anew from the feedforward there is: the loop is not what it was."""
        self._monitor, self._iteration = Monitor(self._joint), 0

    def begin(self, message, reference, given):
        """
        Prepare for the cycle of a joint_trajectory.

        What has been learned for the same motion, law and `reference` (N,) [m] is kept, unless a feedforward is `given`
        (N,) [V]; everything else begins with zeros.
        """
        learned_for = (message.motion, message.learning_law, reference.tobytes())
        if learned_for != self._learned_for or given is not None:
            self._learned_for = learned_for
            self.feedforward = np.zeros(len(reference)) if given is None else given
            self.notice = ''
            self.renew()

    def is_under_way(self):
        """Tell whether the service has still to answer; who has waited too long goes on without."""
        if self._call is not None and self._wall.now().nanoseconds > self._until:
            self._call = None
            self._go_on_without(f'no answer from {self._service.srv_name} for {LEARNING_TIMEOUT} s')
        return self._call is not None

    def learn(self, message, error, gains):
        """Judge the cycle of a joint_trajectory, driven with `error` (N,) [m], and ask for the next feedforward."""
        decision = self._monitor.observe(error, self.feedforward)
        self.feedforward = decision.feedforward
        # the monitor counts cycles since learning began; an update that failed is none
        self._iteration = min(self._iteration, decision.iteration)
        self._cycle = message.cycle
        if decision.message:
            self._tell(decision.message)
        if not decision.learn:
            return
        request = UpdateFeedforward.Request(
            joint=self._joint,
            law=message.learning_law,
            motion=message.motion,
            cycle=message.cycle,
            iteration=self._iteration,
            sample_time=self._sample_time,
            gains=gains_to_msg(gains),
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
        if response.success and (len(feedforward) != samples or not np.isfinite(feedforward).all()):
            refusal = f'learning answered {feedforward} ({len(feedforward)} values); expected {samples} finite ones'
        if refusal:
            self._go_on_without(refusal)
        else:
            self.feedforward = feedforward
            self._iteration += self._asked_by is self._monitor  # not if learning has begun anew meanwhile
        self._on_end()

    def _go_on_without(self, reason):
        self._tell(f'{self._joint}: {reason}; going on with the feedforward there is')

    def _tell(self, notice):
        self.notice = notice
        self._logger.warning(notice)
        self._events.publish(CycleEvent.NOTICE, self._cycle, message=notice)
