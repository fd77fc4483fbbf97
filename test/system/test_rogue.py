"""A running cycle beside a node that publishes on every topic of the cell: nothing of it is believed."""

from threading import Thread
from time import monotonic, sleep

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import UInt32, UInt64

from pkm_core.bag.reader import read_topics
from pkm_core.control.robust import load_control
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles
from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import CycleEvent, EncoderSample, MotorCommand, SampledTrajectory
from pkm_nodes.clients.cell_client import CellClient
from pkm_nodes.clients.cell_processes import CellProcesses
from pkm_nodes.clients.own_bags import read_own
from pkm_nodes.messages.diagnostics import node_of, values_of
from pkm_nodes.runtime.node import LAST_VALUE_QOS, REQUEST_QOS

DOMAIN = 128
SLOW = """
machine: four_dof
lead_rest: 1 ms
move_time: {seconds} s
settle_window: 5 ms
targets:
  - by: {{d1: 2 mm, d3: 2 mm, d5: 2 mm, d7: 2 mm}}
"""
FORGED = {
    'machine': (CycleEvent.STARTED, CycleEvent.FINISHED, CycleEvent.FAULT, CycleEvent.REFUSED, CycleEvent.RESET),
    'recorder': (CycleEvent.RECORDED, CycleEvent.NOT_RECORDED),
    'd1': (CycleEvent.LOADED, CycleEvent.REFUSED),
    'trajectory_generator': (CycleEvent.ANNOUNCED,),
}
GOALS, EVENTS = 40, 2_000  # the campaign sends 200 and 10,000
ANSWERS = 25.0  # [s, wall] every client gets an answer within this time


class Rogue:
    """A node of a process of its own: waits for a cycle, then floods the cell until it is stopped."""

    def __init__(self, session):
        self._session, self.answers, self._ended = session, [], False
        self._context = rclpy.Context()
        self._context.init(domain_id=DOMAIN)
        self._node = rclpy.create_node('rogue', namespace='/pkm', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._samples, self.diagnosed = [], []
        self._node.create_subscription(EncoderSample, 'd1/encoder', self._samples.append, 1000)
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        deep = {f'{kind}_service_qos_profile': REQUEST_QOS for kind in ('goal', 'result')}
        self._goals = ActionClient(self._node, ExecuteMotion, 'execute_motion', **deep)
        self._thread = Thread(target=self._run)
        self._thread.start()

    def _on_diagnostics(self, message):
        found = [values_of(status) for status in message.status if node_of(status) == '/pkm/machine']
        self.diagnosed += [values for values in found if values['fault'] != 'forged']

    def _run(self):
        while not self._samples and not self._ended:
            self._executor.spin_once(timeout_sec=0.05)
        self._make_publishers()
        self._flood_once()
        while not self._ended:
            self._flood()
            sleep(0.02)
            for _ in range(20):
                self._executor.spin_once(timeout_sec=0.001)
        deadline = monotonic() + ANSWERS
        while (len(self.answers) < GOALS or not self.is_named) and monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.01)

    @property
    def is_named(self):
        """Whether the diagnostics of the machine, sent once a second, have named this node."""
        return any(
            int(values['foreign messages']) > 0 and '/pkm/rogue' in values['other publishers']
            for values in self.diagnosed
        )

    def _make_publishers(self):
        def of(kind, topic, qos=1000):
            return self._node.create_publisher(kind, topic, qos)

        self._command, self._encoder = of(MotorCommand, 'd1/command'), of(EncoderSample, 'd3/encoder')
        self._recorder, self._events = of(UInt64, 'recorder/tick'), of(CycleEvent, 'cycle_events', EVENTS)
        self._number = of(UInt32, 'machine/cycle', LAST_VALUE_QOS)
        self._diagnostics = of(DiagnosticArray, '/diagnostics', 10)
        self._trajectories = [of(SampledTrajectory, f'{kind}_trajectory') for kind in ('pose', 'joint')]
        sleep(0.3)  # discovery

    def _flood_once(self):
        self._number.publish(UInt32(data=2**32 - 1))
        for event in range(EVENTS):
            self._tell(event % 12, 'machine', event)
        for _ in range(GOALS):
            sent = self._goals.send_goal_async(ExecuteMotion.Goal(session='sother', motion='four_dof_70ms', cycles=1))
            sent.add_done_callback(lambda future: future.result().get_result_async().add_done_callback(self._note))

    def _note(self, future):
        self.answers.append(future.result().result.message)

    def _flood(self):
        sample = self._samples[-1]
        for ahead in range(30):  # one of them is the tick that the machine waits for
            self._command.publish(MotorCommand(tick=sample.tick + ahead, cycle=sample.cycle, voltage=10.0))
        self._encoder.publish(EncoderSample(tick=sample.tick, cycle=sample.cycle, index=sample.index, position=0.05))
        self._recorder.publish(UInt64(data=2**40))
        for publisher in self._trajectories:
            publisher.publish(SampledTrajectory(cycle=sample.cycle + 1, motion='evil'))
        said = {'state': 'standing', 'cycle': sample.cycle, 'fault': 'forged'}
        values = [KeyValue(key=key, value=str(value)) for key, value in said.items()]
        self._diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(name='/pkm/machine', values=values)]))
        for source, events in FORGED.items():
            for event in events:
                for cycle in (sample.cycle, 2**32 - 1):
                    self._tell(event, source, cycle)

    def _tell(self, event, source, cycle):
        facts = {'samples': 3, 'bag': '/evil', 'message': 'forged', 'session': self._session}
        event = CycleEvent.NOTICE if event == CycleEvent.STOP else event  # anyone may stop the machine
        self._events.publish(CycleEvent(event=event, source=source, cycle=cycle, **facts))

    def close(self):
        self._ended = True
        self._thread.join()
        self._goals.destroy()
        self._node.destroy_node()
        self._context.shutdown()


class EarlyFlood:
    """A process of its own that sends forged cycle events, from before the start of a cell until it is stopped."""

    def __init__(self):
        self._context = rclpy.Context()
        self._context.init(domain_id=DOMAIN)
        self._node = rclpy.create_node('early', namespace='/pkm', context=self._context)
        self._events, self._ended = self._node.create_publisher(CycleEvent, 'cycle_events', EVENTS), False
        self._thread = Thread(target=self._run)
        self._thread.start()

    def _run(self):
        number = 0
        while not self._ended:
            for source, kinds in FORGED.items():
                for kind in kinds:
                    forged = {'source': source, 'cycle': number % 5, 'samples': 3, 'bag': '/evil', 'message': 'forged'}
                    self._events.publish(CycleEvent(event=kind, **forged))
            number += 1
            sleep(0.02)  # 500 events per second

    def close(self):
        self._ended = True
        self._thread.join()
        self._node.destroy_node()
        self._context.shutdown()


@pytest.fixture
def flood(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    flood = EarlyFlood()
    yield flood
    flood.close()


def test_flood_before_the_start_changes_no_bit_of_learning(tmp_path, flood):
    """Such a flood once delayed the answers of learning, and was believed before the machine was known."""
    cell = CellProcesses('four_dof', 'composed', seed=3, environment='nominal', folder=tmp_path)
    with cell, CellClient(session=cell.session) as client:
        client.wait_until_up(cell.check)
        log = client.execute('four_dof_70ms', 3, 'fourier_pid', cell.check, lambda _: None)
    machine = load_machine('four_dof')
    gains, trajectory = load_control(machine), to_joints(machine, plan(machine, load_motion('four_dof_70ms')))
    law = make_law('fourier_pid', machine, gains)
    expected = run_cycles(machine, trajectory, gains, law, cycles=3, seed=3).counts
    for record, counts in zip(read_own(log.bags, cell), expected, strict=True):
        assert np.array_equal(record.counts, counts)
    assert any('cycle events: /pkm/early' in notice for notice in log.notices), log.notices
    assert not any('forged' in notice for notice in log.notices)


@pytest.mark.parametrize('arrangement', ['composed', pytest.param('processes', marks=pytest.mark.slow)])
def test_rogue_on_every_topic_changes_no_bit(tmp_path, monkeypatch, arrangement):
    """Commands, samples, numbers, trajectories, forged events, a burst of them and of goals, during one slow cycle."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    slow = tmp_path / 'slow.yaml'
    slow.write_text(SLOW.format(seconds=1.5))
    cell = CellProcesses('four_dof', arrangement, seed=3, environment='nominal', folder=tmp_path)
    with cell, CellClient(session=cell.session) as client:
        client.wait_until_up(cell.check)
        rogue = Rogue(cell.session)
        try:
            log = client.execute(slow, 1, 'none', cell.check, lambda _: None)
        finally:
            rogue.close()
        again = client.execute('four_dof_70ms', 1, 'none', cell.check, lambda _: None)
    (record,), (after,) = read_own(log.bags, cell), read_own(again.bags, cell)
    assert after.cycle == record.cycle + 1
    assert len(list(cell.bags.iterdir())) == 2
    machine = load_machine('four_dof')
    gains, trajectory = load_control(machine), to_joints(machine, plan(machine, load_motion(slow)))
    assert np.array_equal(record.counts, run_cycles(machine, trajectory, gains, None, cycles=1, seed=3).counts[0])
    assert all(record.recorded[topic] == count for topic, count in record.expected.items())
    assert len(rogue.answers) == GOALS
    assert {answer.partition(';')[0] for answer in rogue.answers} == {"goal: for the cell of session 'sother'"}
    events = read_topics(record.path, ['/pkm/cycle_events'])['/pkm/cycle_events']
    notices = [event.message for event in events if event.event == CycleEvent.NOTICE and event.source == 'machine']
    assert any('/pkm/d1/command: /pkm/rogue' in notice for notice in notices)
    assert not any(event.message == 'forged' for event in events if event.event != CycleEvent.NOTICE)
    assert rogue.is_named
