"""
Node `learning`: the service learning/update; error of one cycle in, feedforward of the next cycle out.

The service learning/save writes the best feedforward of the motion learned last to a file.
"""

from array import array
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.task import Future

from pkm_core.control.controllers import choose_control
from pkm_core.errors import LearningError, PkmError
from pkm_core.learning import make_law
from pkm_core.learning.best import Best
from pkm_core.learning.store import save
from pkm_core.machines import load_machine
from pkm_interfaces.msg import CycleEvent
from pkm_interfaces.srv import SaveLearned, UpdateFeedforward
from pkm_nodes.messages.conversions import learns, trajectory_from_msg
from pkm_nodes.parts.cycle_events import subscribe_events
from pkm_nodes.parts.gain_parameters import gains_from_msg
from pkm_nodes.parts.one_source import subscribe_joint_trajectory
from pkm_nodes.runtime.node import PkmNode, entry_point
from pkm_nodes.runtime.session import require_session

# [s, wall] wait of learning/save for joints without a request for the last cycle; a joint that has restored an earlier
# feedforward sends none
PATIENCE = 3.0
# requests for the last few cycles may come after trajectories of later ones
_KEPT = 4


class _Motion:
    """A motion that is learned: its reference, its laws, and its best feedforward so far."""

    def __init__(self, machine, message, trajectory, law):
        self.asked = {}  # cycle of the last request by joint
        self.belongs_to = message.motion, message.learning_law, message.planned or trajectory.position.tobytes()
        self.best = Best(machine, message.motion, message.learning_law, trajectory, message.planned)
        self.law = cache(lambda *loop: law(message.learning_law, *loop).with_reference(trajectory))


class LearningNode(PkmNode):
    """Serves the laws of pkm_core. The laws have no state; the node keeps the references of the last cycles."""

    def __init__(self, **kwargs):
        super().__init__('learning', **kwargs)
        self._machine = machine = load_machine(self.machine_setting(), self.configuration_setting())
        self._chosen = self.control_setting()
        self._folder = Path(self.setting('folder', 'learned', 'folder in which learning/save may write')).resolve()
        self.check_settings()
        self._loop_gains = choose_control(machine, self._chosen)
        self._law = cache(self._make_law)
        self._motions = {}  # by cycle
        self._learned = None  # the `_Motion` learned last
        self._finished = 0  # the last cycle of the machine
        self._caught_up = None  # Future: every joint has sent its request for that cycle, or PATIENCE is over
        self._patience = self.create_timer(PATIENCE, self._end_wait, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._patience.cancel()
        subscribe_events(self, self._on_event, kinds=(CycleEvent.FINISHED,))
        subscribe_joint_trajectory(self, self._on_trajectory)
        self.create_service(UpdateFeedforward, 'learning/update', self._on_update)
        alone = MutuallyExclusiveCallbackGroup()  # in the common group it would block the requests it waits for
        self.create_service(SaveLearned, 'learning/save', self._on_save, callback_group=alone)
        self.offer('learning/reload', self._reload)

    def _make_law(self, name, *loop):
        """Return the law `name` for the gains of the cell, or for one `loop` (joint, gains) with other gains."""
        law = make_law(name, self._machine, dict([loop]) if loop else self._loop_gains)
        self.get_logger().info(law.verdict)
        return law

    def _on_trajectory(self, message):
        """Make the law, with its convergence test, before the cycle runs."""
        if not learns(message):
            return
        machine = self._machine
        try:
            trajectory = trajectory_from_msg(message, coordinates=machine.joints, sample_time=machine.sample_time)
            motion = _Motion(machine, message, trajectory, self._law)
            same = [known for known in self._motions.values() if known.belongs_to == motion.belongs_to]
            if not same:
                motion.law()
        except PkmError as error:  # refused by the controllers (trajectory) or the trajectory_generator (law)
            self.get_logger().error(f'joint_trajectory of cycle {message.cycle}: {error}')
            return
        others = [(cycle, known) for cycle, known in self._motions.items() if cycle != message.cycle]
        self._motions = dict([*others[1 - _KEPT :], (message.cycle, same[0] if same else motion)])

    def _on_event(self, event):
        if event.event == CycleEvent.FINISHED:
            self._finished = event.cycle

    def _on_update(self, request, response):
        response.session = self.session
        try:
            require_session('learning/update', request.session, self.session)
            error, feedforward = np.array(request.error), np.array(request.feedforward)
            gains = self._gains(request)
            loop = () if gains == self._loop_gains[request.joint] else (request.joint, gains)
            motion = self._motions.get(request.cycle)
            if motion is None or motion.belongs_to[:2] != (request.motion, request.law):
                motion, law = None, self._law(request.law, *loop)
            else:
                law = motion.law(*loop)
            learned = law.update(request.joint, error, feedforward, request.iteration, request.sample_time)
            if motion is not None:
                motion.best.observe(request.joint, gains, error, feedforward, request.iteration)
                self._learned = motion
                motion.asked[request.joint] = request.cycle
                if self._caught_up and not self._is_behind():
                    self._end_wait()
        except PkmError as refusal:
            response.message = str(refusal)
            self.get_logger().error(f'{request.joint}, {request.motion!r}: {refusal}')
            return response
        response.success = True
        response.feedforward = array('d', learned.tobytes())
        return response

    def _reload(self):
        """Load models and gains from the configuration again and drop all laws."""
        self._loop_gains = choose_control(self._machine, self._chosen)
        self._law = cache(self._make_law)
        self._motions.clear()

    def _gains(self, request):
        """Return the gains of the loop that made the error of a request."""
        if request.joint not in self._loop_gains:
            raise LearningError(f'learning: joint {request.joint!r} is unknown; known: {list(self._loop_gains)}')
        if not request.has_gains:
            return self._loop_gains[request.joint]
        return gains_from_msg(request.gains, f'learning {request.joint}: gains')

    def _is_behind(self):
        """Return whether the request of a joint for the last cycle is missing, if that cycle is learned."""
        motion = self._motions.get(self._finished)
        return bool(motion) and any(motion.asked.get(joint, 0) < self._finished for joint in self._machine.joints)

    def _end_wait(self):
        self._patience.cancel()
        if self._caught_up:
            caught_up, self._caught_up = self._caught_up, None
            caught_up.set_result(None)

    def _allowed(self, path):
        """Return `path` if the service may write there: in the folder of this node; `LearningError` otherwise."""
        resolved = (self._folder / path).resolve()
        if not resolved.is_relative_to(self._folder):
            raise LearningError(f'{path}: is not in {self._folder}; allowed: files in the folder of the learning node')
        with suppress(OSError):  # `save` names the reason if there is no folder then
            self._folder.mkdir(parents=True, exist_ok=True)
        return resolved

    async def _on_save(self, request, response):
        if self._is_behind():
            self._caught_up = Future()
            self._patience.reset()
            await self._caught_up
        try:
            require_session('learning/save', request.session, self.session)
            if self._learned is None:
                raise LearningError('nothing has been learned yet')
            learned = self._learned.best.learned()
            save(self._allowed(request.path), learned)
        except PkmError as refusal:
            response.message = str(refusal)
            return response
        response.success = True
        response.message = f'{request.path}: motion {learned.origin.motion!r}, learned by {learned.origin.law!r}'
        return response


main = entry_point(LearningNode)
