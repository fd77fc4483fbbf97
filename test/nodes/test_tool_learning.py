"""Node tool_learning: bits of the core, and the fall back to the joints; the correction in inverse_kinematics."""

from array import array
from functools import cache

import numpy as np
import pytest

from pkm_core.control.robust import load_control
from pkm_core.errors import ConfigError
from pkm_core.learning import make_law
from pkm_core.learning.store import digest_of
from pkm_core.learning.tool import ToolLearning, make_tool_law
from pkm_core.machines import load_machine
from pkm_core.machines.laser_clock import sample_numbers
from pkm_core.motion.planning import Motion, Target, plan
from pkm_core.motion.trajectory import DERIVATIVES, added, to_joints
from pkm_interfaces.msg import CycleError, CycleEvent, LaserSample, SampledTrajectory
from pkm_nodes.messages.conversions import trajectory_from_msg, trajectory_to_msg
from pkm_nodes.nodes import tool_learning
from pkm_nodes.nodes.inverse_kinematics import InverseKinematicsNode
from pkm_nodes.nodes.tool_learning import ToolLearningNode
from pkm_nodes.parts import reference_correction

LAW = 'inverse'


@cache
def planned():
    machine = load_machine('planar')
    targets = [Target(by=dict.fromkeys(machine.joints, 2e-4))]
    poses = plan(machine, Motion(machine='planar', targets=targets, move_time=10e-3))
    return machine, poses, to_joints(machine, poses)


def core():
    """Return the same learning without ROS."""
    machine, poses, joints = planned()
    gains = load_control(machine)
    return ToolLearning(make_tool_law(machine, gains, make_law(LAW, machine, gains), poses, joints))


class Cell:
    """Replacement of everything around the node; the tool goes 1 % too far."""

    def __init__(self, graph, *, laser=True):
        machine = planned()[0]
        self._graph, self._random = graph, np.random.default_rng(6)
        self._poses = graph.publisher(SampledTrajectory, 'pose_trajectory')
        self._joints = graph.publisher(SampledTrajectory, 'joint_trajectory')
        self._events = graph.publisher(CycleEvent, 'cycle_events')
        self._errors = {joint: graph.publisher(CycleError, f'{joint}/cycle_error') for joint in machine.joints}
        self._laser = graph.publisher(LaserSample, 'laser') if laser else None
        self.corrections = graph.listen(SampledTrajectory, 'joint_correction')

    def correction(self, cycle, law=LAW):
        """Plan a cycle and return the correction of its reference."""
        _, poses, _ = planned()
        self._poses.publish(trajectory_to_msg(poses, cycle=cycle, motion='short', learning_law=law))
        self._graph.spin_until(lambda: cycle in [each.cycle for each in self.corrections], f'correction {cycle}')
        message = next(each for each in self.corrections if each.cycle == cycle)
        machine = load_machine('planar')
        return trajectory_from_msg(message, coordinates=machine.joints, sample_time=machine.sample_time)

    def run(self, cycle, correction, *, samples=None):
        """Run a cycle under this correction; return errors and laser samples as the core takes them."""
        machine, poses, joints = planned()
        count = len(poses)
        first = (cycle - 1) * count
        reference = added(joints, correction)
        self._joints.publish(trajectory_to_msg(reference, cycle=cycle, motion='short', learning_law=LAW))
        error = 1e-6 * self._random.standard_normal((count, 2))
        time = sample_numbers(machine, first, first + count)[:samples] * machine.laser_sample_time
        way = 1.01 * (poses.position - poses.position[0])
        ticks = first + np.arange(count)
        seen = np.stack([np.interp(time / machine.sample_time, ticks, column) for column in way.T], axis=1)
        for sample in zip(time, seen, strict=True) if self._laser else ():
            self._laser.publish(LaserSample(time=sample[0], displacement=sample[1].tolist()))
        for joint, column in zip(machine.joints, error.T, strict=True):
            self._errors[joint].publish(CycleError(cycle=cycle, joint=joint, error=array('d', column.tobytes())))
        self._tell(CycleEvent.FINISHED, cycle, tick=first + count, samples=count)
        return error, first, time, seen

    def fail(self, cycle):
        self._tell(CycleEvent.FAULT, cycle)

    def _tell(self, event, cycle, **fields):
        self._events.publish(CycleEvent(event=event, source='machine', cycle=cycle, **fields))


def notices(graph):
    """Return the notices that no test has taken."""
    return [event.message for event in graph.events if event.event == CycleEvent.NOTICE]


def assert_equal(found, expected):
    for name in DERIVATIVES:
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name


def test_correction_is_that_of_the_core_bit_for_bit(graph):
    graph.start(ToolLearningNode, machine='planar')
    cell, learning = Cell(graph), core()
    for cycle in (1, 2, 3):
        correction = cell.correction(cycle)
        assert_equal(correction, learning.motion)
        assert learning.after_cycle(*cell.run(cycle, correction)) == ''
    assert abs(learning.correction).max() > 0.5e-6  # 1 % of 0.2 mm, with the gain of three updates
    assert not notices(graph)


def test_correction_waits_for_measurements_that_come_late(graph):
    graph.start(ToolLearningNode, machine='planar')
    cell, learning = Cell(graph), core()
    first = cell.correction(1)
    _, poses, _ = planned()
    cell._poses.publish(trajectory_to_msg(poses, cycle=2, motion='short', learning_law=LAW))
    graph.spin_in_silence()
    assert [each.cycle for each in cell.corrections] == [1]
    learning.after_cycle(*cell.run(1, first))
    graph.spin_until(lambda: len(cell.corrections) == 2, 'the second correction')
    assert_equal(cell.correction(2), learning.motion)


@pytest.mark.parametrize('laser', [False, True])
def test_without_the_laser_only_the_joints_learn(graph, monkeypatch, laser):
    monkeypatch.setattr(tool_learning, 'PATIENCE', 0.3)
    graph.start(ToolLearningNode, machine='planar')
    cell = Cell(graph, laser=laser)
    for cycle in (1, 2, 3):
        correction = cell.correction(cycle)
        assert not correction.position.any()
        cell.run(cycle, correction, samples=5)
    notice = graph.next_event(CycleEvent.NOTICE, cycle=1)
    assert notice.source == 'tool_learning'
    assert notice.message.startswith(
        f'learning at the tool: laser: no sample {"from 3.2 to" if laser else "in a cycle of"}'
    )
    assert notice.message.endswith('the correction is kept, only the joints learn')
    assert not notices(graph)  # one, not one per cycle


def test_cycle_that_failed_changes_nothing(graph):
    graph.start(ToolLearningNode, machine='planar')
    cell = Cell(graph)
    correction = cell.correction(1)
    cell.fail(1)
    assert_equal(cell.correction(2), correction)
    graph.spin_in_silence()
    assert [each.event for each in graph.events] == [CycleEvent.FAULT]


def test_law_that_diverges_is_refused_with_its_frequency(graph, tmp_path):
    text = load_machine('planar').configuration.find('learning/tool', 'laser').read_text()
    path = tmp_path / 'weak.yaml'
    path.write_text(text.replace('lowest_mode: 300 Hz', 'lowest_mode: 90 Hz'))
    graph.start(ToolLearningNode, machine='planar', tool_law=str(path))
    assert not Cell(graph).correction(1).position.any()
    notice = graph.next_event(CycleEvent.NOTICE)
    assert 'learning at the tool would diverge: the error of d' in notice.message
    assert 'at 90.0 Hz' in notice.message
    assert notice.message.endswith('only the joints learn')


def test_cycle_without_its_correction_is_not_learned_from(graph):
    """A replacement of inverse_kinematics that ignores joint_correction."""
    graph.start(ToolLearningNode, machine='planar')
    cell = Cell(graph)
    nothing = cell.correction(1)
    cell.run(1, nothing)
    assert cell.correction(2).position.any()
    cell.run(2, nothing)
    cell.correction(3)
    notice = graph.next_event(CycleEvent.NOTICE)
    assert 'joint_trajectory was not the planned reference with the correction' in notice.message


class Kinematics:
    """The node inverse_kinematics with the learning target `tool`."""

    def __init__(self, graph):
        graph.start(InverseKinematicsNode, machine='planar', learning_target='tool')
        self._graph = graph
        self._poses = graph.publisher(SampledTrajectory, 'pose_trajectory')
        self._corrections = graph.publisher(SampledTrajectory, 'joint_correction')
        self._joints = graph.listen(SampledTrajectory, 'joint_trajectory')

    def plan(self, cycle, law=LAW):
        self._poses.publish(trajectory_to_msg(planned()[1], cycle=cycle, motion='short', learning_law=law))

    def correct(self, cycle, size):
        learning = core()
        motion = learning.law.motion_of(
            size * np.sin(np.linspace(0, 2 * np.pi, len(planned()[1])))[:, None] * np.ones(2)
        )
        self._corrections.publish(trajectory_to_msg(motion, cycle=cycle, motion='short'))
        return motion

    def joints(self):
        self._graph.spin_until(lambda: self._joints, 'a joint trajectory')
        message, machine = self._joints.pop(), load_machine('planar')
        return message, trajectory_from_msg(message, coordinates=machine.joints, sample_time=machine.sample_time)


@pytest.mark.parametrize('first', ['poses', 'correction'])
def test_correction_is_added_up_to_the_jerk(graph, first):
    """Whichever comes first."""
    node = Kinematics(graph)
    if first == 'poses':
        node.plan(4)
        graph.spin_in_silence()
        motion = node.correct(4, 1e-7)
    else:
        motion = node.correct(4, 1e-7)
        graph.spin_in_silence()
        node.plan(4)
    message, trajectory = node.joints()
    assert_equal(trajectory, added(planned()[2], motion))
    assert message.planned == digest_of(planned()[2])


def test_without_a_correction_the_planned_reference_is_used(graph, monkeypatch):
    monkeypatch.setattr(reference_correction, '_PATIENCE', 0.2)
    node = Kinematics(graph)
    for cycle in (1, 2):
        node.plan(cycle)
        message, trajectory = node.joints()
        assert_equal(trajectory, planned()[2])
        assert message.planned  # the same motion as with a correction: the controllers keep their feedforward
    notice = graph.next_event(CycleEvent.NOTICE, cycle=1)
    assert 'no joint_correction for 0.2 s: is tool_learning running?' in notice.message
    assert not notices(graph)


def test_correction_beyond_the_limits_is_refused_with_a_notice(graph):
    node = Kinematics(graph)
    node.plan(1)
    node.correct(1, 30e-3)
    assert_equal(node.joints()[1], planned()[2])
    notice = graph.next_event(CycleEvent.NOTICE, cycle=1)
    assert 'allowed' in notice.message
    assert notice.message.endswith('the reference is as planned, only the joints learn')


def test_cycle_that_learns_nothing_is_not_corrected(graph):
    node = Kinematics(graph)
    node.correct(4, 1e-7)
    node.plan(4, law='none')
    message, trajectory = node.joints()
    assert_equal(trajectory, planned()[2])
    assert message.planned == ''


def test_unknown_learning_target_is_refused_by_name(graph):
    with pytest.raises(ConfigError, match="learning_target: 'laser' given; allowed: joints, tool"):
        graph.start(InverseKinematicsNode, learning_target='laser')
