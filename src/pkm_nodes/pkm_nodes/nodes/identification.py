"""
Node `identification`: the action identify; moves and excites the axes of a running cell and fits their models.

Every experiment is one cycle: the trajectory_generator runs it, the joint_controllers add the excitation, the recorder
writes its bag. The bags of a joint are fitted in another process while the next joint moves, so that the tick is not
disturbed. Cancelling brakes the machine at once.
"""

from array import array
from datetime import datetime
from math import nan
from pathlib import Path

from rclpy.action import CancelResponse

from pkm_core.control.controllers import choose_control, kind_of
from pkm_core.control.model import load_model
from pkm_core.identification import IdentificationError
from pkm_core.identification.fits import fit_bags, typical_coherence, write_results
from pkm_core.identification.plan import Request, plan
from pkm_core.machines import load_machine
from pkm_interfaces.action import ExecuteMotion, Identify
from pkm_interfaces.msg import Excitation, SampledTrajectory
from pkm_nodes.messages.conversions import experiments_from_msg, fit_to_msg, trajectory_to_msg
from pkm_nodes.parts.cell_cycles import CellCycles
from pkm_nodes.parts.single_goal import SingleGoal
from pkm_nodes.parts.worker import Worker
from pkm_nodes.runtime.node import PkmNode, entry_point


class IdentificationNode(PkmNode):
    """Action server, and client of the trajectory_generator; one goal at a time."""

    def __init__(self, **kwargs):
        super().__init__('identification', **kwargs)
        self._name = self.machine_setting()
        self._chosen = self.control_setting()
        self._folder = Path(self.setting('folder', 'identified', 'folder that takes models and pictures'))
        self.check_settings()
        self._machine = load_machine(self._name)
        self._slow_moves = {}  # bags of the last ones by joint, for a goal of kind SWEEP
        self._cycles = CellCycles(self, IdentificationError)
        self._goal = SingleGoal(self, 'identify', self._cycles)
        self._worker = Worker()
        self._server = self.serve_action(Identify, 'identify', self._execute, self._on_cancel)

    async def _execute(self, goal_handle):
        return await self._goal.run(goal_handle, Identify.Result(), self._identify)

    async def _identify(self, result):
        goal, machine = self._goal.handle.request, self._machine
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
                moving = {'phase': Identify.Feedback.MOVING, 'experiment': experiment.name}
                feedback = self._feedback(joint=joint, **moving)
                feedback.progress, feedback.coherence = done / steps, coherence
                self._goal.handle.publish_feedback(feedback)
                bags.append(await self._run(experiment))
                result.bags.append(str(bags[-1]))
                done += 1
            if request.moves:
                self._slow_moves[joint] = bags[0]
            given = (self.get_namespace(), models, gains, request.sweep().band, folder)
            fits[joint] = self._worker.submit(fit_bags, self._name, joint, bags, *given)
        for joint, fit in fits.items():
            await self._cycles.until(fit.done)
            found[joint], warnings = fit.result()
            done, coherence = done + 1, typical_coherence(found[joint])
            result.warnings += warnings
            result.fits.append(fit_to_msg(found[joint]))
            feedback = self._feedback(phase=Identify.Feedback.FITTING, joint=joint)
            feedback.progress, feedback.coherence = done / steps, coherence
            self._goal.handle.publish_feedback(feedback)
        written = self._worker.submit(
            write_results, folder, self._name, found, models, f'action identify of {machine.name}'
        )
        await self._cycles.until(written.done)
        result.model_file = str(written.result() or '')

    def _feedback(self, **fields):
        return Identify.Feedback(session=self.session, **fields)

    async def _require_cell(self):
        """Raise `IdentificationError` unless every axis has a controller and the cell has a recorder."""
        needed = {f'{joint}/command': f'{joint} is not enabled: no joint_controller' for joint in self._machine.joints}
        needed['recorder/tick'] = 'raw records are kept as bags, but no recorder'
        await self._cycles.require(needed)

    async def _run(self, experiment):
        """Run one experiment as a cycle of the cell and return its bag."""
        if self._goal.handle.is_cancel_requested:
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
        return await self._cycles.run(goal, experiment.name)

    def _on_cancel(self, _):
        self._cycles.stop('identification was cancelled')
        return CancelResponse.ACCEPT

    def destroy_node(self):
        """Destroy the actions and end the process for fits; `Node.destroy_node` does neither."""
        self._server.destroy()
        self._cycles.destroy()
        self._worker.close()
        super().destroy_node()


main = entry_point(IdentificationNode)
