"""Node calibration: refusals and ends of a goal; the test replaces the machine, and its bags by simulated readings."""

import math
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from std_msgs.msg import UInt64

from pkm_core.design import cell_calibration
from pkm_core.design.cell_calibration import Request, plan_cycles, verification_poses
from pkm_core.design.measurement import load_laser, simulate
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.machines.geometry import load_geometry
from pkm_interfaces.action import Calibrate
from pkm_interfaces.msg import CycleEvent, LaserSample, MotorCommand
from pkm_nodes.nodes.calibration import CalibrationNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.parts.worker import Worker

MACHINE = load_machine('planar')
POSES, REQUEST = {'poses': 12, 'verification': 6}, Request(12, 6)
ERRORS = {'l2': 12e-6, 'l4': -7e-6, 'd1': 3e-6}


class Readings:
    """What the bags of a cell would hold: readings of the laser and the encoders at rest."""

    def __init__(self, folder):
        self._folder, self._calls = folder, 0
        self.later = np.zeros(2)  # [m] by which the last pose is off at the second visit
        self.failure = None  # raised instead of the first readings

    def __call__(self, machine, bags, namespace, averaging):
        self._calls += 1
        if self._calls == 1:
            if self.failure:
                raise self.failure
            poses, off = np.vstack(plan_cycles(machine, REQUEST)), 0.0
        else:
            machine, off = load_machine(self._folder / 'new' / 'planar.yaml'), self.later
            poses = verification_poses(machine, REQUEST)
        seen = simulate(MACHINE, ERRORS, load_laser(), machine.inverse(poses), seed=self._calls)
        seen.displacement[-1] += off
        return seen


class Client:
    """Sends goals of calibrate and plays the machine meanwhile."""

    def __init__(self, graph, stand_in):
        self._graph, self.stand_in = graph, stand_in
        self._client = ActionClient(graph.node, Calibrate, 'calibrate')
        self.feedback = []

    def send(self, **goal):
        self._graph.spin_until(self._client.server_is_ready, 'the action server')
        sent = self._client.send_goal_async(
            Calibrate.Goal(**{'folder': 'new'} | POSES | goal),
            lambda message: self.feedback.append(message.feedback),
        )
        self._graph.spin_until(sent.done, 'the acceptance of the goal')
        return sent.result()

    def run_cycle(self, cycle):
        trajectory = self.stand_in.run(cycle)
        self.stand_in.tell(CycleEvent.RECORDED, cycle, bag=f'/bags/{cycle}')
        return trajectory

    def end(self, handle):
        future = handle.get_result_async()
        self._graph.spin_until(future.done, 'the result of the goal')
        return future.result().status, future.result().result

    def close(self):
        self._client.destroy()


@pytest.fixture
def readings(tmp_path, monkeypatch):
    """Replace the bags by readings, and the process for fits by this one."""

    def submit(_, work, *arguments):
        done = Future()
        try:
            done.set_result(work(*arguments))
        except Exception as error:
            done.set_exception(error)
        return done

    monkeypatch.setattr(Worker, 'submit', submit)
    readings = Readings(tmp_path)
    monkeypatch.setattr(cell_calibration, 'measure', readings)
    return readings


@pytest.fixture
def client(graph, stand_in, tmp_path, readings):
    graph.start(CalibrationNode, machine='planar', folder=str(tmp_path))
    client = Client(graph, stand_in)
    yield client
    client.close()


def offer(graph, *, without=()):
    """Publish what a goal requires of a cell."""
    kinds = {'d1/command': MotorCommand, 'd3/command': MotorCommand, 'recorder/tick': UInt64, 'laser': LaserSample}
    for topic, kind in kinds.items():
        if topic not in without:
            graph.node.create_publisher(kind, topic, 1000)


@pytest.fixture
def cell(graph, client, tmp_path):
    offer(graph)
    return graph.start(TrajectoryGeneratorNode, machine='planar', calibrated=str(tmp_path))


def geometry_of(cell):
    return cell._geometry.geometry.digest


DRAWN = load_geometry('planar').digest


def test_accepted_calibration_is_in_use(graph, cell, client, tmp_path):
    goal = client.send()
    first = client.run_cycle(1)
    second = client.run_cycle(2)
    status, result = client.end(goal)
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    calibrated = load_geometry(tmp_path / 'new' / 'planar.yaml')
    assert (result.file, result.geometry) == (calibrated.file, calibrated.digest)
    assert (first.geometry, second.geometry) == (DRAWN, calibrated.digest)
    assert geometry_of(cell) == calibrated.digest
    assert list(result.bags) == ['/bags/1', '/bags/2']
    assert dict(zip(result.parameters, result.estimates, strict=True))['l4'] == pytest.approx(-7e-6, abs=3e-6)
    assert max(result.after) < 1e-6 < 3e-6 < max(result.before)
    assert 0.3 < result.misfit < 1.5
    phases = [message.phase for message in client.feedback]
    assert sorted(set(phases)) == [Calibrate.Feedback.MOVING, Calibrate.Feedback.FITTING, Calibrate.Feedback.LOADING]
    assert {message.poses for message in client.feedback if message.phase == Calibrate.Feedback.MOVING} == {18, 6}
    assert {path.name for path in (tmp_path / 'new').iterdir()} == {
        'planar.yaml',
        'measurements.csv',
        'calibration.png',
    }


def test_geometry_that_is_worse_in_use_is_restored(graph, cell, client, readings):
    readings.later = np.array([80e-6, 0.0])
    goal = client.send()
    client.run_cycle(1)
    assert client.run_cycle(2).geometry != DRAWN
    status, result = client.end(goal)
    assert status == GoalStatus.STATUS_ABORTED
    assert 'x: error at 6 other poses' in result.message
    assert result.message.endswith('the former geometry is in use again')
    assert (result.geometry, geometry_of(cell)) == (DRAWN, DRAWN)


def test_kept_geometry_stays_in_use_beside_the_file(cell, client, tmp_path):
    goal = client.send(keep=True)
    client.run_cycle(1)
    status, result = client.end(goal)
    assert (status, result.geometry) == (GoalStatus.STATUS_SUCCEEDED, DRAWN)
    assert Path(result.file).is_file()
    assert max(result.after) < 1e-6


@pytest.mark.parametrize(
    ('failure', 'text'),
    [
        (PkmError('poses_0001: laser: stamp 4 is 0.2 s after 0.3 s'), 'poses_0001: laser: stamp 4 is'),
        (PkmError('calibration: misfit 4.30 of the noise; allowed 1.5'), 'misfit 4.30 of the noise; allowed 1.5'),
        (ValueError('sizes differ'), 'fit_bags: ValueError: sizes differ'),
    ],
)
def test_failed_fit_leaves_the_former_geometry(cell, client, readings, tmp_path, failure, text):
    readings.failure = failure
    goal = client.send()
    client.run_cycle(1)
    status, result = client.end(goal)
    assert status == GoalStatus.STATUS_ABORTED
    assert text in result.message
    assert (result.file, result.geometry, geometry_of(cell)) == ('', DRAWN, DRAWN)
    assert list(result.bags) == ['/bags/1'], 'the bag is kept'
    assert not (tmp_path / 'new').exists()


@pytest.mark.parametrize('cycle', [1, 2])
def test_cancelled_goal_leaves_the_former_geometry(graph, cell, client, cycle):
    """In the cycle of the fit, or in that of the check, when the new geometry is in use."""
    goal = client.send()
    for number in range(1, cycle):
        client.run_cycle(number)
    client.stand_in.start(cycle)
    cancelled = goal.cancel_goal_async()
    graph.spin_until(cancelled.done, 'the answer to the cancellation')
    client.stand_in.finish(cycle)
    client.stand_in.tell(CycleEvent.RECORDED, cycle, bag=f'/bags/{cycle}')
    status, result = client.end(goal)
    assert status == GoalStatus.STATUS_CANCELED
    assert result.message.startswith('cancelled; the machine stands at home')
    assert len(result.bags) == cycle
    assert (result.geometry, geometry_of(cell)) == (DRAWN, DRAWN)


def test_fault_in_a_cycle_ends_the_goal_with_its_reason(cell, client):
    goal = client.send()
    client.stand_in.start(1)
    client.stand_in.tell(CycleEvent.FAULT, 1, message='the door is open')
    status, result = client.end(goal)
    assert (status, result.message) == (GoalStatus.STATUS_ABORTED, 'cycle 1 of 1: machine: the door is open')


def test_second_goal_is_refused_while_one_runs(cell, client):
    first = client.send()
    client.stand_in.start(1)
    _, result = client.end(client.send())
    assert result.message == 'another goal of calibrate is running; wait for its end or cancel it'
    client.stand_in.tell(CycleEvent.FAULT, 1, message='enough')
    client.end(first)


@pytest.mark.parametrize(
    ('goal', 'reason'),
    [
        ({'poses': 3}, 'calibration: 3 poses given; allowed 4 to 200 for planar'),
        ({'poses': 2000}, 'calibration: 2000 poses given; allowed 4 to 200 for planar'),
        ({'verification': 2}, 'calibrate: 2 poses of verification; allowed 4 to 200'),
        ({'wait': math.nan}, 'calibrate: wait is nan s; allowed above 0 to 5 s'),
        ({'averaging': -0.1}, 'calibrate: averaging is -0.1 s; allowed above 0 to 5 s'),
        ({'averaging': 0.05001}, 'expected a multiple of 0.5 ms'),
        ({'folder': '../other'}, '../other: is not in '),
    ],
)
def test_infeasible_goal_is_refused_before_any_motion(cell, client, stand_in, goal, reason):
    status, result = client.end(client.send(**goal))
    assert status == GoalStatus.STATUS_ABORTED
    assert reason in result.message
    assert not stand_in.trajectories


def test_existing_file_is_not_overwritten(cell, client, stand_in, tmp_path):
    (tmp_path / 'new').mkdir()
    (tmp_path / 'new' / 'planar.yaml').write_text('mine')
    _, result = client.end(client.send())
    assert 'planar.yaml: exists already' in result.message
    assert (tmp_path / 'new' / 'planar.yaml').read_text() == 'mine'
    assert not stand_in.trajectories


@pytest.mark.parametrize(
    ('missing', 'reason'),
    [
        ('laser', 'the end point is measured by laser, but no laser publishes /pkm/laser'),
        ('recorder/tick', 'rests are read from bags, but no recorder publishes /pkm/recorder/tick'),
        ('d3/command', 'd3 is not enabled: no controller publishes /pkm/d3/command'),
    ],
)
def test_cell_without_a_part_is_refused(graph, client, tmp_path, monkeypatch, missing, reason):
    monkeypatch.setattr('pkm_nodes.parts.cell_cycles._DISCOVERY', 0.5)
    offer(graph, without=[missing])
    graph.start(TrajectoryGeneratorNode, machine='planar', calibrated=str(tmp_path))
    status, result = client.end(client.send())
    assert (status, result.message) == (GoalStatus.STATUS_ABORTED, reason)
