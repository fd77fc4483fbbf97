"""Config hash of a bag: that of the files loaded by the controllers, not of the files on disk."""

import re
import shutil
from functools import partial

import pytest
from action_msgs.msg import GoalStatus
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from pkm_core.bag.reader import read_metadata
from pkm_core.config import Configuration
from pkm_core.machines import load_machine
from pkm_core.recording.provenance import config_hash, loop_hash, machine_hash, truth_hash
from pkm_interfaces.msg import CycleEvent, PlatformPose
from pkm_nodes.nodes.inverse_kinematics import InverseKinematicsNode
from pkm_nodes.nodes.joint_controller import JointControllerNode
from pkm_nodes.nodes.machine import MachineNode
from pkm_nodes.nodes.recorder import RecorderNode
from pkm_nodes.nodes.state_estimator import StateEstimatorNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode

MACHINE = 'xy_stage'


@pytest.fixture
def config(tmp_path, monkeypatch):
    """Return a copy of the configuration that the nodes of the test read."""
    folder = shutil.copytree(Configuration.of_environment().folder, tmp_path / 'config')
    monkeypatch.setenv('PKM_CONFIG', str(folder))
    return folder


@pytest.fixture
def cell(config, graph, tmp_path):
    """Start a cell of real nodes without learning."""
    graph.start(MachineNode, machine=MACHINE, wait_for_recorder=True)
    for joint in load_machine(MACHINE).joints:
        named = partial(JointControllerNode, name=f'joint_controller_{joint}')  # as in a cell
        graph.start(named, machine=MACHINE, joint=joint)
    for node_type in (TrajectoryGeneratorNode, InverseKinematicsNode, StateEstimatorNode):
        graph.start(node_type, machine=MACHINE)
    graph.start(RecorderNode, machine=MACHINE, folder=str(tmp_path / 'bags'))


def scale_kp(config, factor):
    """Multiply kp of all axes in the file of gains."""
    file = config / 'control' / f'{MACHINE}.yaml'
    file.write_text(re.sub(r'(kp: )([\d.]+)', lambda found: f'{found[1]}{factor * float(found[2])}', file.read_text()))


def loop_of_files():
    return loop_hash(load_machine(MACHINE), 'robust', machine_hash(MACHINE))


def test_bag_has_the_hash_of_the_loaded_files(graph, cell, config, goals):
    """Cases: no change; edited but not reloaded; one of two controllers reloaded; both reloaded."""
    machine = load_machine(MACHINE)
    x, y = machine.forward(machine.home)

    def hash_of_next_bag():
        goal = goals.send(poses=[PlatformPose(x=x + 1e-4, y=y)], move_time=0.01)
        assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
        return read_metadata(graph.next_event(CycleEvent.RECORDED).bag)['custom_data']['config_hash']

    def hash_of_files():
        return config_hash([loop_of_files(), truth_hash(load_machine(MACHINE))], 'poses', 'none')

    first = hash_of_files()
    assert hash_of_next_bag() == first
    assert hash_of_next_bag() == first
    scale_kp(config, 1.02)
    assert hash_of_files() != first
    assert hash_of_next_bag() == first
    assert graph.call(Trigger, 'x/reload').success
    assert hash_of_next_bag() not in (first, hash_of_files())
    assert graph.call(Trigger, 'y/reload').success
    assert hash_of_next_bag() == hash_of_files()


def test_refused_reload_keeps_the_hash(graph, config):
    node = graph.start(JointControllerNode, machine=MACHINE, joint='x')
    before = node.get_parameter('config_hash').value
    assert before == loop_of_files()
    scale_kp(config, 30.0)
    assert not graph.call(Trigger, 'x/reload').success
    assert node.get_parameter('config_hash').value == before != loop_of_files()


def test_reload_keeps_the_machine_of_the_start(graph, config):
    """A reload loads model and gains only."""
    node = graph.start(JointControllerNode, machine=MACHINE, joint='x')
    before = node.get_parameter('config_hash').value
    file = config / 'machines' / f'{MACHINE}.yaml'
    file.write_text(file.read_text() + '# edited\n')
    assert graph.call(Trigger, 'x/reload').success
    assert node.get_parameter('config_hash').value == before != loop_of_files()


def test_config_hash_is_set_by_the_node_only(graph):
    node = graph.start(JointControllerNode, machine=MACHINE, joint='x')
    result = node.set_parameters([Parameter('config_hash', value='0123456789ab')])[0]
    assert not result.successful
    assert result.reason == "config_hash: '0123456789ab' given; only the node itself sets it, with its reload"
