"""Node trajectory_generator: goals with a learned feedforward, and refused laws."""

import re

import numpy as np
import pytest
from action_msgs.msg import GoalStatus

from pkm_core.config import find_config
from pkm_core.control.robust import load_control
from pkm_core.learning import make_law
from pkm_core.learning.store import Learned, origin_of, read, save
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_nodes.messages.conversions import trajectory_from_msg
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from support.goals import JOINTS, MOTION, NEAR_HOME


@pytest.fixture
def learned(machine, tmp_path):
    """Return the path of a feedforward learned on MOTION, and that feedforward (N, n)."""
    trajectory = to_joints(machine, plan(machine, load_motion(MOTION)))
    feedforward = np.random.default_rng(2).normal(size=trajectory.position.shape)
    origin = origin_of(machine, MOTION, 'inverse', load_control(machine), trajectory)
    save(tmp_path / 'learned.npz', Learned(origin, feedforward, {}))
    return tmp_path / 'learned.npz', feedforward


@pytest.mark.parametrize('law', ['none', 'fourier'])
def test_first_trajectory_carries_the_learned_feedforward(graph, goals, stand_in, learned, law):
    path, feedforward = learned
    graph.start(TrajectoryGeneratorNode)
    goal = goals.send(motion=MOTION, cycles=2, learning_law=law, learned=str(path))
    first, second = (stand_in.run(cycle) for cycle in (1, 2))
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
    assert np.array_equal(first.feedforward, feedforward.ravel())
    assert len(second.feedforward) == 0


def test_learned_feedforward_of_another_motion_is_refused(graph, goals, stand_in, learned):
    path, _ = learned
    graph.start(TrajectoryGeneratorNode)
    status, result = goals.result(goals.send(poses=[NEAR_HOME], learned=str(path)))
    assert status == GoalStatus.STATUS_ABORTED
    assert f"{path}: was learned for another motion '{MOTION}', here 'poses'; reference" in result.message
    assert not stand_in.trajectories


def test_learned_feedforward_of_other_gains_is_refused(graph, goals, stand_in, learned):
    path, _ = learned
    graph.start(TrajectoryGeneratorNode, control='four_dof_thesis')
    status, result = goals.result(goals.send(motion=MOTION, learned=str(path)))
    assert status == GoalStatus.STATUS_ABORTED
    assert f'{path}: was learned for another config' in result.message
    assert not stand_in.trajectories


def test_feedforward_of_the_wrong_length_is_refused(graph, goals, learned):
    path, feedforward = learned
    save(path, Learned(read(path).origin, feedforward[:-1], {}))
    graph.start(TrajectoryGeneratorNode)
    status, result = goals.result(goals.send(motion=MOTION, learned=str(path)))
    assert status == GoalStatus.STATUS_ABORTED
    assert 'feedforward has shape (679, 4); expected (680, 4)' in result.message


def test_basis_parameters_give_the_feedforward_of_another_motion(graph, goals, stand_in, machine, learned):
    path, feedforward = learned
    graph.start(TrajectoryGeneratorNode)
    gains, trajectory = load_control(machine), to_joints(machine, plan(machine, load_motion(MOTION)))
    law = make_law('basis', machine, gains)
    bound = law.with_reference(trajectory)
    parameters = {joint: bound.parameters(joint, column) for joint, column in zip(JOINTS, feedforward.T, strict=True)}
    save(path, Learned(origin_of(machine, MOTION, 'basis', gains, trajectory), feedforward, parameters))
    goal = goals.send(poses=[NEAR_HOME], learning_law='basis', learned=str(path))
    message = stand_in.run(1)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
    poses = trajectory_from_msg(message, coordinates=machine.coordinates, sample_time=machine.sample_time)
    there = law.with_reference(to_joints(machine, poses))
    expected = [there.feedforward(joint, parameters[joint], rested=True) for joint in JOINTS]
    assert np.array_equal(np.reshape(message.feedforward, (-1, 4)), np.stack(expected, axis=1))


def test_divergent_law_is_refused_before_anything_moves(graph, goals, stand_in, tmp_path):
    text = find_config('learning', 'inverse').read_text()
    (tmp_path / 'wide.yaml').write_text(text.replace('fall_to: 208 Hz', 'fall_to: 300 Hz').replace('160 Hz', '260 Hz'))
    graph.start(TrajectoryGeneratorNode)
    status, result = goals.result(goals.send(motion=MOTION, learning_law=str(tmp_path / 'wide.yaml')))
    assert status == GoalStatus.STATUS_ABORTED
    assert re.search(
        r"wide.yaml' would diverge: the error of d\d at .* Hz is multiplied by \d\.\d+ per cycle", result.message
    )
    assert not stand_in.trajectories
