"""Node dashboard: state of the cell, goals and service calls; test/system/test_page.py tests the page."""

import math
from functools import partial

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.srv import ListParameters
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from pkm_core.machines.geometry import load_geometry
from pkm_interfaces.msg import CycleEvent, CycleMetrics, Geometry, SampledTrajectory
from pkm_nodes.nodes.computed_torque_controller import ComputedTorqueControllerNode
from pkm_nodes.nodes.dashboard import DashboardNode
from pkm_nodes.nodes.machine import MachineNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.page.cell import Cell, Status
from pkm_nodes.runtime.node import LAST_VALUE_QOS, PkmNode

OK, ERROR = DiagnosticStatus.OK, DiagnosticStatus.ERROR
BUILT = """
built:
  specimen: {machine: planar, origin: simulated, seed: 1, environment: nominal}
  l2: 70.013 mm
  l4: 69.991 mm
  dy: 10.004 mm
  marks: {d1: 0.002 mm, d3: -0.001 mm}
"""


@pytest.fixture
def dashboard(graph):
    return graph.start(DashboardNode)


def measure(cell, cycle, *errors):
    for joint, error in zip(cell.machine.joints, errors, strict=True):
        cell.measure(CycleMetrics(cycle=cycle, joint=joint, max_dynamic_error=error))


def test_dashboard_reads_the_machine_parameter_of_each_machine(graph, dashboard):
    assert dashboard.cell.machine is None
    first = graph.start(MachineNode, machine='four_dof')

    def stands(name):
        cell = dashboard.cell
        return cell.machine is not None and cell.machine.name == name and cell.status == Status.STANDING

    graph.spin_until(lambda: stands('four_dof'), 'a standing machine')
    graph.stop(first)
    graph.spin_until(lambda: dashboard.cell.status == Status.AWAY, 'the end of the machine')
    graph.start(MachineNode, machine='planar')
    graph.spin_until(lambda: stands('planar'), 'a standing machine')
    metrics = graph.publisher(CycleMetrics, 'd3/cycle_metrics')
    metrics.publish(CycleMetrics(cycle=4, joint='d3', max_dynamic_error=1e-6))
    graph.spin_until(lambda: dashboard.cell.errors == {4: {'d3': 1e-6}}, 'metrics of the new machine')


def test_geometry_exchanged_in_the_cell_is_drawn(graph, dashboard, tmp_path):
    graph.start(MachineNode, machine='planar')
    graph.spin_until(lambda: dashboard.cell.machine, 'the machine to be known')
    drawn, file = load_geometry('planar'), tmp_path / 'planar.yaml'
    file.write_text(drawn.text + BUILT)
    announced = {'file': str(file), 'geometry': drawn.exchanged(str(file), file.read_text()).digest}
    publisher = graph.publisher(Geometry, 'geometry', LAST_VALUE_QOS)
    publisher.publish(Geometry(node='state_estimator', **announced))
    publisher.publish(Geometry(node='trajectory_generator', **announced))
    graph.spin_until(lambda: dashboard.cell.geometry.startswith('calibrated'), 'the lengths of the file')
    assert dashboard.cell.machine.config.built.l2 == 70.013e-3


def test_odd_messages_change_nothing_on_the_page(graph, dashboard, machine):
    graph.start(MachineNode)
    graph.spin_until(lambda: dashboard.cell.machine, 'the machine to be known')
    before = dashboard.cell.positions
    joints = graph.publisher(JointState, 'joint_states')
    joints.publish(JointState(name=['d1', 'd3'], position=[1.0]))
    plans = graph.publisher(SampledTrajectory, 'pose_trajectory')
    for position in ([], [0.0, 1.0, 2.0]):
        odd = SampledTrajectory(motion='odd', coordinates=list(machine.coordinates), position=position)
        plans.publish(odd)
    graph.publisher(CycleMetrics, 'd1/cycle_metrics').publish(CycleMetrics(cycle=1, joint='<b>'))
    odd = Geometry(node='trajectory_generator', file='/dev/zero', geometry='0' * 12)
    graph.publisher(Geometry, 'geometry', LAST_VALUE_QOS).publish(odd)
    graph.spin_until(lambda: 'is no regular file' in dashboard.cell.geometry, 'the refusal of the file')
    graph.spin_in_silence()
    assert (dashboard.cell.positions, dashboard.cell.motion, dashboard.cell.errors) == (before, '', {})


def test_restarted_machine_resets_the_cycle_number(graph, dashboard, machine):
    dashboard.cell = Cell(machine)
    dashboard.cell.hear(CycleEvent(event=CycleEvent.STARTED, cycle=5))
    measure(dashboard.cell, 5, *4 * [1e-6])
    diagnostics = graph.publisher(DiagnosticArray, '/diagnostics')

    def say(tick):
        status = DiagnosticStatus(name='/pkm/machine', values=[KeyValue(key='tick', value=tick)])
        diagnostics.publish(DiagnosticArray(status=[status]))

    say('3400')
    graph.spin_until(lambda: dashboard.cell.status == Status.STANDING, 'the diagnostics')
    assert (dashboard.cell.cycle, dashboard.cell.best_cycle) == (5, 5)
    say('0')
    graph.spin_until(lambda: not dashboard.cell.errors, 'the new beginning')
    assert (dashboard.cell.cycle, dashboard.cell.best_cycle) == (0, 0)


@pytest.mark.parametrize(
    ('values', 'level', 'status', 'reason'),
    [
        ({'state': 'standing'}, OK, Status.STANDING, ''),
        ({'state': 'running'}, OK, Status.RUNNING, ''),
        ({'state': 'held'}, OK, Status.RUNNING, ''),
        ({'state': 'paused'}, OK, Status.RUNNING, ''),
        ({'state': 'faulted', 'fault': 'tick 3: hit'}, ERROR, Status.FAULT, 'tick 3: hit'),
        ({}, OK, Status.STANDING, ''),
        ({}, ERROR, Status.FAULT, 'running, fault: of a drive'),
    ],
)
def test_status_is_read_from_keys_of_diagnostics(graph, dashboard, machine, values, level, status, reason):
    """The last two cases are other machines, whose diagnostics have no keys."""
    dashboard.cell = Cell(machine)
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    message = DiagnosticStatus(name='/pkm/machine', level=level, message='running, fault: of a drive', values=pairs)
    graph.publisher(DiagnosticArray, '/diagnostics').publish(DiagnosticArray(status=[message]))
    graph.spin_until(lambda: dashboard.cell.status == status, f'the status {status}')
    assert dashboard.cell.reason == reason


def test_missing_and_duplicate_nodes_are_named(graph, dashboard):
    graph.start(MachineNode)
    first, second = graph.start(TrajectoryGeneratorNode), graph.start(TrajectoryGeneratorNode)

    def states():
        return {line.name: (line.good, line.text) for line in dashboard.cell.nodes}

    graph.spin_until(lambda: states().get('machine') == (True, 'standing'), 'the diagnostics of the machine')
    graph.spin_until(lambda: 'learning' in states(), 'the list of the nodes of this machine')
    assert states()['trajectory_generator'] == (False, '2 of that name')
    assert states()['linear_motor_d1'] == (True, 'up')
    assert states()['learning'] == states()['joint_controller_d1'] == (False, 'missing')
    graph.start(ComputedTorqueControllerNode)
    graph.spin_until(lambda: states().get('computed_torque_controller') == (True, 'up'), 'the controller of all joints')
    assert 'joint_controller_d1' not in states()
    assert 'recorder' not in states(), 'a cell may run without one'
    graph.stop(first)
    graph.stop(second)


def test_refused_goals_show_the_reason(graph, dashboard):
    graph.start(MachineNode)
    graph.start(TrajectoryGeneratorNode)
    graph.spin_until(lambda: dashboard.cell.machine, 'the machine to be known')
    for wish, text in (
        (('run', 'no_such_motion', 1, 'none'), "'no_such_motion' is unknown"),
        (('visit', {'x': 0.5, 'y': 0.0, 'z': 0.0, 'phi': 0.0}), 'mm; allowed '),
    ):
        dashboard.fulfil(wish)
        graph.spin_until(lambda text=text: text in dashboard.cell.notice.text, 'the refusal')
        assert not dashboard.cell.notice.good


def test_buttons_without_a_cell_name_the_missing_node(graph, dashboard, machine):
    dashboard.cell = Cell(machine)
    for wish, missing in (
        (('run', 'four_dof_70ms', 1, 'none'), 'trajectory_generator'),
        (('visit', dict.fromkeys(machine.coordinates, 0.0)), 'trajectory_generator'),
        (('stop',), 'trajectory_generator'),
        (('brake',), 'machine'),
        (('reset',), 'machine'),
        (('pause', True), 'machine'),
        (('step',), 'machine'),
        (('pace', 0.5), 'machine'),
    ):
        dashboard.fulfil(wish)
        assert f'no {missing} offers' in dashboard.cell.notice.text
        assert not dashboard.cell.notice.good


def test_stop_cancels_the_goal_of_another_client(graph, dashboard):
    graph.start(MachineNode)
    graph.start(TrajectoryGeneratorNode)
    other = graph.start(DashboardNode)
    graph.spin_until(lambda: dashboard.cell.machine and other.cell.machine, 'the machine to be known')
    other.fulfil(('run', 'four_dof_70ms', 3, 'none'))  # waits for joint controllers that do not exist
    graph.spin_until(lambda: other.cell.motion, 'the goal to be planned')
    dashboard.fulfil(('stop',))
    graph.spin_until(lambda: 'stop: 1 goal(s)' in dashboard.cell.notice.text, 'the goal to be cancelled')


def test_pace_pause_and_step_reach_a_machine_that_offers_them(graph, dashboard, machine):
    """The machine is a stand-in with the agreed names: parameter pace, services machine/pause and machine/step."""
    stand_in = graph.start(partial(PkmNode, 'machine'))
    asked = []
    stand_in.declare_parameter('pace', 0.0)
    stand_in.create_service(SetBool, 'machine/pause', lambda request, answer: take(asked, request.data, answer))
    stand_in.create_service(Trigger, 'machine/step', lambda _, answer: take(asked, 'step', answer))
    dashboard.cell = Cell(machine)
    pairs = {'state': 'paused', 'pace': '0.5', 'pace reached': '', 'paused': 'true'}
    values = [KeyValue(key=key, value=value) for key, value in pairs.items()]
    diagnostics = graph.publisher(DiagnosticArray, '/diagnostics')

    def is_offered():
        status = DiagnosticStatus(name='/pkm/machine', message='paused', values=values)
        diagnostics.publish(DiagnosticArray(status=[status]))
        return dashboard.cell.pace.offered

    graph.spin_until(is_offered, 'the services')
    pace = dashboard.cell.pace
    assert (dashboard.cell.status, pace.asked, pace.paused, math.isnan(pace.reached)) == (
        Status.RUNNING,
        0.5,
        True,
        True,
    )
    for wish in (('pause', False), ('step',), ('pace', 0.25)):
        before = dashboard.cell.notice
        dashboard.fulfil(wish)
        graph.spin_until(lambda before=before: dashboard.cell.notice is not before, f'the answer to {wish}')
        assert dashboard.cell.notice.good
    assert asked == [False, 'step']
    assert stand_in.get_parameter('pace').value == 0.25


def take(asked, what, answer):
    asked.append(what)
    answer.success = True
    return answer


def test_reset_shows_the_answer_of_the_machine(graph, dashboard):
    graph.start(MachineNode)
    graph.spin_until(lambda: dashboard.cell.machine, 'the machine to be known')
    dashboard.fulfil(('reset',))
    graph.spin_until(lambda: dashboard.cell.notice.text, 'the answer')
    assert dashboard.cell.notice.text == 'reset: at home; there was no fault'
    assert dashboard.cell.notice.good


def test_dashboard_lists_its_parameters(graph, dashboard):
    # an attribute once hid that of rclpy, and the first request of a recorder ended the page
    answer = graph.call(ListParameters, '/pkm/dashboard/list_parameters')
    assert {'host', 'port'} <= set(answer.result.names)
