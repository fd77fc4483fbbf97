"""
Node `identification`: the action identify; moves and excites the axes of a running cell and fits their models.

Every experiment is one cycle: the trajectory_generator runs it, the joint_controllers add the excitation, the recorder
writes its bag. The bags of a joint are fitted in another process while the next joint moves, so that the tick is not
disturbed. Cancelling brakes the machine at once.
"""

from array import array
from contextlib import ExitStack
from datetime import datetime
from math import inf, nan
from pathlib import Path

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.task import Future

from pkm_core.control.controllers import choose_control, kind_of
from pkm_core.control.model import load_model
from pkm_core.errors import PkmError
from pkm_core.identification import IdentificationError
from pkm_core.identification.fits import fit_bags, typical_coherence, write_results
from pkm_core.identification.plan import Request, plan
from pkm_core.machines import load_machine
from pkm_core.parallel import search_executor
from pkm_interfaces.action import ExecuteMotion, Identify
from pkm_interfaces.msg import CycleEvent, Excitation, SampledTrajectory
from pkm_nodes.messages.conversions import experiments_from_msg, fit_to_msg, trajectory_to_msg
from pkm_nodes.parts.cycle_events import CycleEvents, subscribe_events
from pkm_nodes.parts.presence import Presence
from pkm_nodes.runtime.node import PkmNode, entry_point
from pkm_nodes.runtime.session import require_session

# [s, wall] to find the other nodes, and from the end of a cycle to its closed bag
_DISCOVERY = 5.0
_RECORDED = 10.0


class IdentificationNode(PkmNode):
    """Action server, and client of the trajectory_generator; one goal at a time."""

    def __init__(self, **kwargs):
        super().__init__('identification', **kwargs)
        self._name = self.machine_setting()
        self._chosen = self.control_setting()
        self._folder = Path(self.setting('folder', 'identified', 'folder that takes models and pictures'))
        self.check_settings()
        self._machine = load_machine(self._name)
        self._goal = None  # the handle of the running goal
        self._cycle = 0  # started last
        self._bags = {}  # path by cycle
        self._slow_moves = {}  # bags of the last ones by joint, for a goal of kind SWEEP
        self._waiting = (lambda: True, inf, Future())  # condition, deadline, future
        self._events = CycleEvents(self, 'identification')
        subscribe_events(self, self._on_event)
        self._wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(0.05, self._look, clock=self._wall)
        self._timer.cancel()
        self._workers = ExitStack()
        self._pool = None
        self._motion = ActionClient(self, ExecuteMotion, 'execute_motion')
        self._server = ActionServer(self, Identify, 'identify', self._execute, cancel_callback=self._on_cancel)

    async def _execute(self, goal_handle):
        """Run one goal; a refused one is aborted at once, because only a result carries a reason."""
        result = Identify.Result(session=self.session)
        if self._goal is not None:
            result.message = 'another goal of identify is running; wait for its end or cancel it'
            goal_handle.abort()
            return result
        self._goal = goal_handle
        try:
            require_session('goal', goal_handle.request.session, self.session)
            await self._identify(goal_handle, result)
        except PkmError as error:
            result.message = str(error)
        finally:
            self._goal = None
        if goal_handle.is_cancel_requested:
            result.message = result.message or 'cancelled after the last cycle; the machine stands at home'
            goal_handle.canceled()
        elif result.message:
            self.get_logger().error(f'identify: {result.message}')
            goal_handle.abort()
        else:
            goal_handle.succeed()
        return result

    async def _identify(self, goal_handle, result):
        goal, machine = goal_handle.request, self._machine
        request = Request(
            tuple(goal.joints),
            experiments_from_msg(goal.kind),
            goal.positions,
            tuple(goal.band.tolist()),
            goal.voltage,
            goal.jog_speed,
            goal.stroke,
        )
        models, gains = load_model(machine), choose_control(machine, self._chosen)
        if kind_of(gains) != 'robust':
            raise IdentificationError(
                f'control {self._chosen!r}: expected one whose controllers take an excitation, robust'
            )
        plans = plan(machine, request, models, gains)
        unknown = [joint for joint in plans if not request.moves and joint not in self._slow_moves]
        if unknown:
            raise IdentificationError(
                f'kind {request.kind!r}: no slow moves of {unknown} yet; send a goal of kind BOTH'
            )
        await self._require_cell()
        folder = self._folder / f'{machine.name}_{datetime.now():%Y%m%dT%H%M%S}'
        steps = sum(map(len, plans.values())) + len(plans)
        done, coherence, fits, found = 0, nan, {}, {}
        for joint, experiments in plans.items():
            bags = [] if request.moves else [self._slow_moves[joint]]
            for experiment in experiments:
                feedback = Identify.Feedback(
                    session=self.session, phase=Identify.Feedback.MOVING, joint=joint, experiment=experiment.name
                )
                feedback.progress, feedback.coherence = done / steps, coherence
                goal_handle.publish_feedback(feedback)
                bags.append(await self._run(experiment))
                result.bags.append(str(bags[-1]))
                done += 1
            if request.moves:
                self._slow_moves[joint] = bags[0]
            given = (self.get_namespace(), models, gains, request.sweep().band, folder)
            fits[joint] = self._submit(fit_bags, self._name, joint, bags, *given)
        for joint, fit in fits.items():
            await self._until(fit.done)
            found[joint], warnings = fit.result()
            done, coherence = done + 1, typical_coherence(found[joint])
            result.warnings += warnings
            result.fits.append(fit_to_msg(found[joint]))
            feedback = self._feedback(phase=Identify.Feedback.FITTING, joint=joint)
            feedback.progress, feedback.coherence = done / steps, coherence
            goal_handle.publish_feedback(feedback)
        written = self._submit(write_results, folder, self._name, found, models, f'action identify of {machine.name}')
        await self._until(written.done)
        result.model_file = str(written.result() or '')

    def _feedback(self, **fields):
        return Identify.Feedback(session=self.session, **fields)

    async def _require_cell(self):
        """Raise `IdentificationError` unless every axis has a controller and the cell has a recorder."""
        needed = {f'{joint}/command': f'{joint} is not enabled: no joint_controller' for joint in self._machine.joints}
        needed['recorder/tick'] = 'raw records are kept as bags, but no recorder'

        def missing():
            return [topic for topic in needed if self.count_publishers(self.resolve_topic_name(topic)) == 0]

        if not await self._until(lambda: not missing() and self._motion.server_is_ready(), _DISCOVERY):
            reasons = [f'{needed[topic]} publishes {self.resolve_topic_name(topic)}' for topic in missing()]
            raise IdentificationError('; '.join(reasons) or 'no trajectory_generator offers execute_motion')

    async def _run(self, experiment):
        """Run one experiment as a cycle of the cell and return its bag."""
        if self._goal.is_cancel_requested:
            raise IdentificationError(f'cancelled before {experiment.name}; the machine stands at home')
        joints = enumerate(self._machine.joints)
        named = {'cycle': 0, 'motion': experiment.name, 'kind': SampledTrajectory.IDENTIFICATION}
        goal = ExecuteMotion.Goal(
            session=self.session,
            cycles=1,
            experiment=trajectory_to_msg(experiment.trajectory, **named),
            excitation=[
                Excitation(joint=joint, voltage=array('d', experiment.excitation[:, column].tobytes()))
                for column, joint in joints
            ],
        )
        before, generator = self._cycle, Presence(self, 'execute_motion/_action/status')
        sent = self._motion.send_goal_async(goal)
        ended = None
        if await self._until_done(sent, generator):
            ended = sent.result().get_result_async()
        if ended is None or not await self._until_done(ended, generator):
            raise IdentificationError(f'{experiment.name}: the trajectory_generator is gone; start it again')
        answer = ended.result()
        if answer.status != GoalStatus.STATUS_SUCCEEDED:
            raise IdentificationError(f'{experiment.name}: {answer.result.message}')
        if not await self._until(lambda: self._cycle > before and self._cycle in self._bags, _RECORDED):
            raise IdentificationError(f'{experiment.name}: the recorder has closed no bag within {_RECORDED:g} s')
        return self._bags.pop(self._cycle)

    async def _until_done(self, future, server):
        """Wait for `future`; return False if `server`, a `Presence`, leaves the graph first."""
        await self._until(lambda: future.done() or server.has_ended())
        return future.done()

    def _submit(self, work, *arguments):
        """Return the concurrent future of `work` in the process for fits."""
        if self._pool is None:
            self._pool = self._workers.enter_context(search_executor(1, ''))
        return self._pool.submit(work, *arguments)

    def _until(self, condition, timeout=inf):
        """Return a future that becomes True when `condition()` holds, or False after `timeout` [s, wall]."""
        self._waiting = condition, self._seconds() + timeout, Future()
        self._timer.reset()
        self._look()
        return self._waiting[-1]

    def _look(self):
        condition, deadline, future = self._waiting
        met = bool(condition())
        if met or self._seconds() > deadline:
            self._timer.cancel()
            future.set_result(met)

    def _on_event(self, event):
        if self._goal is None:
            return
        if event.event == CycleEvent.STARTED:
            self._cycle = event.cycle
            if self._goal.is_cancel_requested:
                self._stop()
        elif event.event == CycleEvent.RECORDED:
            self._bags[event.cycle] = Path(event.bag)

    def _on_cancel(self, _):
        self._stop()  # a standing machine ignores it
        return CancelResponse.ACCEPT

    def _stop(self):
        self._events.publish(CycleEvent.STOP, self._cycle, message='identification was cancelled')

    def _seconds(self):
        return self._wall.now().nanoseconds * 1e-9

    def destroy_node(self):
        """Destroy the actions and end the process for fits; `Node.destroy_node` does neither."""
        self._server.destroy()
        self._motion.destroy()
        self._workers.close()
        super().destroy_node()


main = entry_point(IdentificationNode)
