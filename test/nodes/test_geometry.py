"""Exchange of the kinematics of a cell between two goals: every node takes up the machine file, or none does."""

from functools import partial

import pytest
from action_msgs.msg import GoalStatus
from rclpy.qos import DurabilityPolicy, QoSProfile

from pkm_core.machines import load_machine
from pkm_core.machines.geometry import load_geometry
from pkm_core.recording.provenance import loop_hash, machine_hash
from pkm_interfaces.msg import CycleEvent, PlatformPose, SampledTrajectory
from pkm_interfaces.msg import Geometry as GeometryMessage
from pkm_interfaces.srv import LoadGeometry, SetGeometry
from pkm_nodes.nodes.inverse_kinematics import InverseKinematicsNode
from pkm_nodes.nodes.joint_controller import JointControllerNode
from pkm_nodes.nodes.state_estimator import StateEstimatorNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.parts import cell_geometry
from pkm_nodes.runtime.node import LAST_VALUE_QOS

DRAWN = load_geometry('planar')
BUILT = """
built:
  specimen: {machine: planar, origin: simulated, seed: 1, environment: nominal}
  l2: 70.013 mm
  l4: 69.991 mm
  dy: 10.004 mm
  marks: {d1: 0.002 mm, d3: -0.001 mm}
"""
ALL_LAST_VALUES = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def file(tmp_path):
    """Return a calibrated machine file in the folder of the trajectory generator."""
    folder = tmp_path / 'calibrated'
    folder.mkdir()
    file = folder / 'planar.yaml'
    file.write_text(DRAWN.text + BUILT)
    return file


@pytest.fixture
def used(graph):
    """Return {node: last Geometry}."""
    found = {}
    graph.node.create_subscription(
        GeometryMessage, 'geometry', lambda message: found.update({message.node: message}), ALL_LAST_VALUES
    )
    return found


@pytest.fixture
def cell(graph, file, used):
    """Start the nodes of a planar cell that hold kinematics, and return a function that calls geometry/load."""
    graph.start(TrajectoryGeneratorNode, machine='planar', calibrated=str(file.parent))
    graph.start(InverseKinematicsNode, machine='planar')
    estimator = graph.start(StateEstimatorNode, machine='planar')
    graph.start(partial(JointControllerNode, name='joint_controller_d1'), machine='planar', joint='d1')
    graph.spin_until(lambda: len(used) == 4, 'the geometry of every node')

    def load(file):
        return graph.call(LoadGeometry, 'geometry/load', LoadGeometry.Request(file=file))

    load.estimator = estimator
    return load


def hashes(graph, used):
    graph.spin_in_silence()
    return {message.geometry for message in used.values()}


def test_load_exchanges_the_geometry_of_every_node(graph, cell, used, file):
    """The former one comes back on request."""
    calibrated = load_geometry(file)
    assert {(m.geometry, m.calibrated, m.file) for m in used.values()} == {(DRAWN.digest, False, 'planar')}
    answer = cell('planar.yaml')
    assert answer.success, answer.message
    assert answer.geometry == calibrated.digest != DRAWN.digest
    assert hashes(graph, used) == {calibrated.digest}
    assert {(m.calibrated, m.file) for m in used.values()} == {(True, str(file))}
    notice = graph.next_event(CycleEvent.NOTICE, source='trajectory_generator', cycle=1)
    assert f'geometry of {file}, hash {calibrated.digest}, is in use' in notice.message
    assert cell('').geometry == DRAWN.digest
    assert hashes(graph, used) == {DRAWN.digest}


def test_config_hash_is_that_of_a_cell_started_with_the_file(graph, file, used):
    graph.start(TrajectoryGeneratorNode, machine='planar', calibrated=str(file.parent))
    controller = graph.start(JointControllerNode, machine='planar', joint='d1')
    before = controller.get_parameter('config_hash').value
    graph.call(LoadGeometry, 'geometry/load', LoadGeometry.Request(file=str(file)))
    expected = loop_hash(load_machine(file), 'robust', machine_hash(file))
    assert controller.get_parameter('config_hash').value == expected != before


def test_refusal_of_one_node_leaves_all_with_the_former(graph, cell, used, file):
    """The node of another machine is the last one in the order of the exchange."""
    node = graph.start(partial(FourDofEstimator, 'z_estimator'))
    before = {name: message.geometry for name, message in used.items() if name != node.get_name()}
    answer = cell(str(file))
    assert not answer.success
    assert 'z_estimator: ' in answer.message
    assert "mechanism: 'planar' given; expected 'four_dof'" in answer.message
    assert f'geometry {DRAWN.digest} of planar stays in use' in answer.message
    graph.spin_in_silence()
    assert {name: used[name].geometry for name in before} == before


class FourDofEstimator(StateEstimatorNode):
    """State estimator of another machine, under a name of its own."""

    def __init__(self, name, **kwargs):
        super().__init__(cli_args=['--ros-args', '-r', f'__node:={name}'], **kwargs)


def test_node_without_an_answer_is_named(graph, cell, used, file, monkeypatch):
    monkeypatch.setattr(cell_geometry, '_ANSWER', 0.3)
    graph.publisher(GeometryMessage, 'geometry', LAST_VALUE_QOS)  # of the test's node, without a service
    answer = cell(str(file))
    assert not answer.success
    assert 'test: does not offer test/geometry; start it again' in answer.message
    assert hashes(graph, used) == {DRAWN.digest}


@pytest.mark.parametrize(
    ('name', 'reason'),
    [
        ('../planar.yaml', 'is not in '),
        ('four_dof.yaml', "is a file of machine 'four_dof'; this cell has 'planar'"),
        ('new/planar.yaml', 'cannot be read: No such file or directory'),
    ],
)
def test_file_outside_the_folder_or_of_another_name_is_refused(graph, used, file, name, reason):
    """Its content is checked by test/core/machines/test_geometry.py."""
    graph.start(TrajectoryGeneratorNode, machine='planar', calibrated=str(file.parent))
    answer = graph.call(LoadGeometry, 'geometry/load', LoadGeometry.Request(file=name))
    assert not answer.success
    assert reason in answer.message
    assert hashes(graph, used) == {DRAWN.digest}


def test_request_of_another_session_is_refused(graph, used, file):
    graph.start(TrajectoryGeneratorNode, machine='planar', session='s1', calibrated=str(file.parent))
    graph.start(InverseKinematicsNode, machine='planar', session='s1')
    for service, name in ((LoadGeometry, 'geometry/load'), (SetGeometry, 'inverse_kinematics/geometry')):
        answer = graph.call(service, name, service.Request(session='s2', file='planar.yaml'))
        assert not answer.success
        assert answer.message == f"{name}: for the cell of session 's2'; this cell has session 's1'"
    assert hashes(graph, used) == {DRAWN.digest}


@pytest.fixture
def near_home():
    machine = load_machine('planar')
    x, y = machine.forward(machine.home + 1e-3)
    return PlatformPose(x=x, y=y)


def test_load_is_refused_during_a_goal(graph, cell, goals, stand_in, near_home):
    goal = goals.send(poses=[near_home])
    stand_in.start(1)
    answer = cell('planar.yaml')
    assert not answer.success
    assert "motion 'poses', cycle 1 of 1 is running; wait for its end or cancel it" in answer.message
    stand_in.finish(1)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
    assert cell('planar.yaml').success


def test_restarted_node_gets_the_geometry_before_a_cycle(graph, cell, goals, stand_in, used, file, near_home):
    assert cell('planar.yaml').success
    graph.next_event(CycleEvent.NOTICE)
    graph.stop(cell.estimator)
    graph.start(StateEstimatorNode, machine='planar')
    graph.spin_until(lambda: used['state_estimator'].geometry == DRAWN.digest, 'the restarted node')
    joints = graph.listen(SampledTrajectory, 'joint_trajectory')
    goal = goals.send(poses=[near_home])
    trajectory = stand_in.run(1)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
    calibrated = load_geometry(file).digest
    assert used['state_estimator'].geometry == calibrated
    assert {trajectory.geometry, joints[0].geometry} == {calibrated}
    assert 'state_estimator: was given the geometry of the cell' in graph.next_event(CycleEvent.NOTICE, cycle=1).message
