"""Plans of goals: from a request to the messages of its cycles, or the reason why it cannot be run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pkm_core.control.controllers import choose_control, kind_of
from pkm_core.control.feasibility import drive_check
from pkm_core.control.model import load_model
from pkm_core.errors import TrajectoryError
from pkm_core.identification.plan import in_poses
from pkm_core.learning import make_law
from pkm_core.learning.initial import first_feedforward
from pkm_core.motion.planning import load_motion, plan, pose_rows, poses_motion, still_moves
from pkm_core.motion.point_to_point import pose_target, way_to
from pkm_core.motion.trajectory import to_joints
from pkm_interfaces.msg import PlatformPose
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage
from pkm_nodes.messages.conversions import trajectory_from_msg, trajectory_to_msg

_COORDINATES = tuple(PlatformPose.get_fields_and_field_types())


@dataclass(frozen=True, eq=False)
class PlannedGoal:
    """A goal that can be run: the messages of its cycles, [(topic, message)], and where each of them ends."""

    name: str
    first: list
    later: list
    end: np.ndarray  # (n,) [m] joint positions


class GoalPlans:
    """
    Plans the goals of `node`, the trajectory_generator.

    Parameters
    ----------
    node : PkmNode
    geometry : NodeGeometry
        Has the machine.
    chosen : str
        Choice of the controllers, see `choose_control`.
    standing : Standing
        Where the next cycle begins.

    """

    def __init__(self, node, geometry, chosen, standing):
        self._node, self._geometry, self._chosen, self._standing = node, geometry, chosen, standing
        self.reload()

    @property
    def machine(self):
        """The `Machine` in use."""
        return self._geometry.machine

    def reload(self):
        """Read the gains of the configuration again; learning laws are checked with them before a goal begins."""
        machine = self._geometry.machine
        self._gains, self._models = choose_control(machine, self._chosen), load_model(machine)

    def of_motion(self, request):
        """Return the `PlannedGoal` of an ExecuteMotion.Goal; `PkmError` unless all its cycles can be run."""
        if not request.cycles:
            raise TrajectoryError('goal: cycles is 0; expected at least 1')
        kind = kind_of(self._gains)
        if request.controller not in ('', kind):
            raise TrajectoryError(f'goal: controller {request.controller!r}; this cell has been started with {kind!r}')
        experiment = request.experiment
        if bool(request.motion) + bool(request.poses) + bool(experiment.coordinates) != 1:
            raise TrajectoryError(
                f'goal: motion {request.motion!r}, {len(request.poses)} poses and experiment {experiment.motion!r}; '
                f'give one of them'
            )
        for name in ('move_time', 'rest_time'):
            value = getattr(request, name)
            if request.motion and value != 0:
                raise TrajectoryError(f'goal: {name} is {value} s; motion {request.motion!r} has its own, expected 0')
        if experiment.coordinates:
            return self._of_experiment(request)
        machine = self._geometry.machine
        if request.motion:
            motion, name = load_motion(request.motion), Path(request.motion).stem
            motion = motion.model_copy(update={'stay': True}) if request.stay else motion
        else:
            poses = pose_rows(machine, [_values(pose) for pose in request.poses])
            times = request.move_time or None, request.rest_time or None
            motion, name = poses_motion(machine, poses, *times, stay=request.stay), 'poses'
        if motion.stay:
            _check_once(request)
        trajectory = plan(machine, motion, self.check, self._standing.position)
        joints = to_joints(machine, trajectory)  # refuses what inverse_kinematics would refuse after the start
        self._warn_of_still_moves(name, joints)
        begin = self._begin_learning(request, name, joints)
        law = request.learning_law or 'none'
        messages = (self._messages(trajectory, name, law, motion.stay, feedforward=each) for each in (begin, None))
        return PlannedGoal(name, *messages, joints.position[-1])

    def to_pose(self, request):
        """Return the `PlannedGoal` of a GoTo.Goal."""
        machine, standing = self._geometry.machine, self._standing.position
        target = pose_target(machine, standing, _values(request.pose), request.coordinates, relative=request.relative)
        return self._to(target, request.move_time, 'go_to')

    def to_home(self, request):
        """Return the `PlannedGoal` of a Home.Goal."""
        return self._to(self._geometry.machine.home, request.move_time, 'home')

    def of_joints(self, joints, name):
        """Return the `PlannedGoal` of a `SampledTrajectory` in joints within the limits of the machine."""
        poses = in_poses(self._geometry.machine, joints)
        self.check(joints)
        return PlannedGoal(name, *2 * (self._messages(poses, name),), joints.position[-1])

    def _to(self, target, move_time, name):
        """Return the `PlannedGoal` of one move to the joint positions `target` (n,) [m]."""
        machine = self._geometry.machine
        poses = way_to(machine, self._standing.position, target, move_time, self.check)
        joints = to_joints(machine, poses)
        self._warn_of_still_moves(name, joints)
        return PlannedGoal(name, *2 * (self._messages(poses, name),), target)

    def of_piece(self, piece, name):
        """Return the `PlannedGoal` of one `Piece` of a jog; its message gets the number of the running cycle."""
        extends = {'offset': piece.offset, 'hold': piece.hold}
        return PlannedGoal(name, *2 * (self._messages(piece.poses, name, **extends),), np.array(piece.end))

    def check(self, joints):
        """Raise `PkmError` for a joint trajectory that a drive cannot follow by its model."""
        drive_check(self._geometry.machine, self._models)(joints)

    def _messages(self, trajectory, name, law='none', stay=True, feedforward=None, **extends):
        geometry = self._geometry.geometry.digest
        named = {'cycle': 0, 'motion': name, 'learning_law': law, 'stay': stay, 'geometry': geometry}
        return [('pose_trajectory', trajectory_to_msg(trajectory, **named, **extends, feedforward=feedforward))]

    def _warn_of_still_moves(self, name, joints):
        still = still_moves(self._geometry.machine, joints)
        if still:
            self._node.get_logger().warning(f'{name}: {still}')

    def _begin_learning(self, request, name, joints):
        """
        Return the learned feedforward (N, n) [V] of the first cycle, or None.

        Refuses, before anything moves, a law that would diverge and a file learned for something else.
        """
        machine, law = self._geometry.machine, request.learning_law or 'none'
        if law != 'none':
            self._node.get_logger().info(make_law(law, machine, self._gains).verdict)
        if not request.learned:
            return None
        return first_feedforward(request.learned, machine, name, law, self._gains, joints)

    def _of_experiment(self, request):
        """Return the `PlannedGoal` of an experiment of identification."""
        machine, experiment = self._geometry.machine, request.experiment
        if kind_of(self._gains) != 'robust':
            raise TrajectoryError(
                f'goal: experiment {experiment.motion!r}; only a cell with robust control has excitation'
            )
        if request.learning_law not in ('', 'none') or request.move_time != 0 or request.stay:
            raise TrajectoryError(
                f'goal: learning_law {request.learning_law!r}, move_time {request.move_time} s and stay {request.stay} '
                f"with experiment {experiment.motion!r}; expected 'none', 0 and False"
            )
        excited = [excitation.joint for excitation in request.excitation]
        if sorted(excited) != sorted(machine.joints):
            raise TrajectoryError(f'goal: excitation of {excited}; expected one of each of {list(machine.joints)}')
        joints = trajectory_from_msg(experiment, coordinates=machine.joints, sample_time=machine.sample_time)
        if not self._standing.is_at_home:
            raise TrajectoryError(
                f'goal: experiment {experiment.motion!r} begins at home; the machine stands elsewhere; call the action '
                f'home first'
            )
        self._standing.check(joints)
        named = {'cycle': 0, 'motion': experiment.motion, 'kind': SampledTrajectoryMessage.IDENTIFICATION}
        named['geometry'] = self._geometry.geometry.digest
        messages = [
            *(('excitation', excitation) for excitation in request.excitation),
            ('pose_trajectory', trajectory_to_msg(in_poses(machine, joints), **named)),
            ('joint_trajectory', trajectory_to_msg(joints, **named)),
        ]
        return PlannedGoal(experiment.motion, messages, messages, joints.position[-1])


def _values(pose):
    """Return {coordinate: value [m, rad]} of a PlatformPose."""
    return {name: getattr(pose, name) for name in _COORDINATES}


def _check_once(request):
    """Refuse what a motion with `stay` cannot do: its second cycle begins elsewhere."""
    law = request.learning_law or 'none'
    if request.cycles != 1 or law != 'none' or request.learned:
        raise TrajectoryError(
            f'goal: {request.cycles} cycles, learning_law {law!r} and learned {request.learned!r} of a motion that '
            f"stays; expected 1, 'none' and '': its next cycle begins elsewhere"
        )
