"""
Node `calibration`: the action calibrate; measures a running cell by laser, fits its lengths and takes them up.

The poses are visited by cycles of the trajectory_generator; the recorder writes one bag per cycle. Plan and fit run in
another process. The cell takes up a calibrated file by geometry/load only if it predicts other poses better than the
geometry in use; if the laser then finds commanded poses worse than before, the former geometry comes back.
"""

from array import array
from datetime import datetime
from math import nan
from pathlib import Path

from rclpy.action import CancelResponse
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pkm_core.design.calibration_motion import MOVE_TIME
from pkm_core.design.cell_calibration import Request, check_bags, check_cycles, fit_bags, plan_cycles
from pkm_core.errors import PkmError
from pkm_core.machines.geometry import load_geometry
from pkm_interfaces.action import Calibrate, ExecuteMotion
from pkm_interfaces.msg import PlatformPose
from pkm_interfaces.srv import LoadGeometry
from pkm_nodes.parts.cell_cycles import CellCycles
from pkm_nodes.parts.node_geometry import NodeGeometry
from pkm_nodes.parts.single_goal import SingleGoal
from pkm_nodes.parts.worker import Worker
from pkm_nodes.runtime.node import CALIBRATED, PkmNode, entry_point

# [s, wall] for the answer of geometry/load, which waits for every node
_EXCHANGED = 60.0
# [s, wall] period of the feedback while poses are visited
_FEEDBACK = 0.5


class CalibrationNode(PkmNode):
    """Action server, and client of the trajectory_generator; one goal at a time."""

    def __init__(self, **kwargs):
        super().__init__('calibration', **kwargs)
        self._name = self.machine_setting()
        self._folder = Path(self.setting('folder', 'calibrated', CALIBRATED)).resolve()
        self.check_settings()
        self._of_start = load_geometry(self._name)
        self._geometry = NodeGeometry(self, self._of_start)
        self._cycles = CellCycles(self)
        self._worker = Worker()
        self._goal = SingleGoal(self, 'calibrate', self._cycles)
        self._visit = (0, 0, 1.0)  # poses visited in earlier cycles, all poses, time from one to the next [s]
        self._load = self.create_client(LoadGeometry, 'geometry/load')
        self._timer = self.create_timer(_FEEDBACK, self._report_pose, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()
        self._server = self.serve_action(Calibrate, 'calibrate', self._execute, lambda _: CancelResponse.ACCEPT)

    async def _execute(self, goal_handle):
        result = await self._goal.run(goal_handle, Calibrate.Result(misfit=nan), self._calibrate)
        result.geometry = self._geometry.geometry.digest
        return result

    async def _calibrate(self, result):
        goal = self._goal.handle.request
        request = Request(goal.poses, goal.verification, goal.wait, goal.averaging, goal.seed)
        before, file = self._geometry.geometry, self._place(goal.folder)
        await self._require_cell()
        poses = await self._computed(plan_cycles, before.machine, request)
        bags = await self._visited(poses, request, result)
        self._tell(Calibrate.Feedback.FITTING)
        fitting = before.machine, self._name, bags, self.get_namespace(), request, file
        found = await self._computed(fit_bags, *fitting)
        result.file = str(file)
        _fill(result, found, found.verification)
        self._refuse_worse(found.verification, before)
        if goal.keep:
            return
        try:
            self._tell(Calibrate.Feedback.LOADING)
            await self._exchange(str(file))
            again = await self._computed(check_cycles, self._geometry.machine, request)
            bags = await self._visited(again, request, result)
            checked = await self._computed(check_bags, found, bags, self.get_namespace(), request)
            _fill(result, found, checked)
            self._refuse_worse(checked, before)
        except PkmError as error:
            await self._restore(before, error)

    def _place(self, folder):
        """Return the file to write in `folder`, in the folder of this node; `PkmError` if it exists or lies outside."""
        name = self._of_start.machine.name
        folder = folder or f'{name}_{datetime.now():%Y%m%dT%H%M%S}'
        file = (self._folder / folder).resolve() / f'{name}.yaml'
        if not file.is_relative_to(self._folder):
            raise PkmError(f'{folder}: is not in {self._folder}; allowed: folders in that of the calibration node')
        if file.exists():
            raise PkmError(f'{file}: exists already; allowed: a folder without a file of that name')
        return file

    async def _require_cell(self):
        """Raise `PkmError` unless the cell has controllers, a recorder and a laser."""
        joints = self._of_start.machine.joints
        needed = {f'{joint}/command': f'{joint} is not enabled: no controller' for joint in joints}
        needed |= {'recorder/tick': 'rests are read from bags, but no recorder'}
        needed |= {'laser': 'the end point is measured by laser, but no laser'}
        await self._cycles.require(needed)

    async def _computed(self, work, *arguments):
        """Return ``work(*arguments)``, computed by the worker; every failure is a `PkmError`."""
        done = self._worker.submit(work, *arguments)
        await self._cycles.until(done.done)
        self._refuse_cancelled()
        failure = done.exception()
        if failure is None or isinstance(failure, PkmError):
            return done.result()
        raise PkmError(f'{work.__name__}: {type(failure).__name__}: {failure}')

    async def _visited(self, cycles, request, result):
        """Visit the poses (k, m) of each of `cycles` and return their bags."""
        machine, bags, visited, total = self._geometry.machine, [], 0, sum(map(len, cycles))
        for number, poses in enumerate(cycles, start=1):
            self._refuse_cancelled()
            named = [dict(zip(machine.coordinates, pose, strict=True)) for pose in poses.tolist()]
            goal = ExecuteMotion.Goal(
                session=self.session,
                poses=[PlatformPose(**pose) for pose in named],
                move_time=MOVE_TIME,
                rest_time=request.rest,
                cycles=1,
            )
            self._visit = visited, total, MOVE_TIME + request.rest
            self._timer.reset()
            self._report_pose()
            try:
                bags.append(await self._cycles.run(goal, f'cycle {number} of {len(cycles)}'))
            finally:
                self._timer.cancel()
            result.bags.append(str(bags[-1]))
            visited += len(poses)
        return bags

    def _refuse_cancelled(self):
        if self._goal.handle.is_cancel_requested:
            raise PkmError('cancelled; the machine stands at home')

    def _refuse_worse(self, verification, before):
        """Raise `PkmError` if the `verification` has a coordinate that is worse than with the geometry `before`."""
        if not verification.accepted:
            raise PkmError('; '.join(verification.reasons(before.machine)))

    async def _exchange(self, file):
        """Make the cell take up `file`, or the geometry of its start (''); `PkmError` if it refuses."""
        answer = self._load.call_async(LoadGeometry.Request(session=self.session, file=file))
        if not await self._cycles.until(answer.done, _EXCHANGED):
            raise PkmError(f'no answer from {self._load.srv_name} within {_EXCHANGED:g} s')
        if not answer.result().success:
            raise PkmError(answer.result().message)

    async def _restore(self, before, error):
        """Make the cell take up the geometry `before` again because of `error`, and raise it with the outcome."""
        if self._geometry.geometry.digest == before.digest:
            raise PkmError(f'{error}; the former geometry stays in use')
        try:
            await self._exchange('' if before.digest == self._of_start.digest else before.file)
        except PkmError as refusal:
            raise PkmError(f'{error}; the former geometry could not be taken up again: {refusal}') from None
        raise PkmError(f'{error}; the former geometry is in use again')

    # feedback

    def _report_pose(self):
        visited, total, duration = self._visit
        if self._cycles.first_tick is not None:
            machine, now = self._geometry.machine, self.get_clock().now().nanoseconds * 1e-9
            visited += int(max(0.0, now - self._cycles.first_tick * machine.sample_time) / duration)
        self._tell(Calibrate.Feedback.MOVING, min(visited, total), total)

    def _tell(self, phase, pose=0, poses=0):
        progress = 0.8 * pose / poses if poses else {Calibrate.Feedback.FITTING: 0.8}.get(phase, 0.9)
        named = {'session': self.session, 'phase': phase, 'pose': pose, 'poses': poses, 'progress': progress}
        self._goal.handle.publish_feedback(Calibrate.Feedback(**named))

    def destroy_node(self):
        """Destroy the actions and end the worker; `Node.destroy_node` does neither."""
        self._server.destroy()
        self._cycles.destroy()
        self._worker.close()
        super().destroy_node()


def _fill(result, found, verification):
    """Write the figures of a `CellCalibration` and of its last `Verification` into the `result`."""
    calibration = found.calibration
    result.misfit, result.weakest = calibration.misfit, found.weakest
    result.coordinates = list(verification.coordinates)
    for name in ('before', 'after', 'before_largest', 'after_largest', 'noise'):
        setattr(result, name, array('d', getattr(verification, name).tolist()))
    result.parameters = list(calibration.errors)
    result.estimates = array('d', calibration.errors.values())
    result.deviations = array('d', calibration.deviations.values())


main = entry_point(CalibrationNode)
