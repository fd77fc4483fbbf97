"""Node trajectory_generator: sequence of cycles, and the ends of a goal other than success."""

import time

import pytest
from action_msgs.msg import GoalStatus
from std_msgs.msg import UInt32

from pkm_interfaces.msg import CycleEvent
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.runtime.node import LAST_VALUE_QOS, PkmNode
from support.goals import MOTION


class SilentMachine(PkmNode):
    """What the graph shows of a machine during a tick: a publisher that is silent."""

    def __init__(self, **kwargs):
        super().__init__('machine', **kwargs)
        self.create_publisher(UInt32, 'machine/cycle', LAST_VALUE_QOS)


def test_second_goal_is_refused_and_the_first_one_continues(graph, goals, stand_in):
    graph.start(TrajectoryGeneratorNode)
    first = goals.send(motion=MOTION, cycles=2)
    stand_in.start(1)
    status, result = goals.result(goals.send(motion=MOTION))
    assert status == GoalStatus.STATUS_ABORTED
    assert f"goal '{MOTION}': motion '{MOTION}', cycle 1 of 2 is running" in result.message
    stand_in.finish(1)
    stand_in.run(2)
    status, result = goals.result(first)
    assert (status, result.cycles_completed) == (GoalStatus.STATUS_SUCCEEDED, 2)


def test_cancelled_goal_ends_after_the_running_cycle(graph, goals, stand_in):
    graph.start(TrajectoryGeneratorNode)
    goal = goals.send(motion=MOTION, cycles=3)
    stand_in.start(1)
    cancelled = goal.cancel_goal_async()
    graph.spin_until(cancelled.done, 'the answer to the cancellation')
    stand_in.finish(1)
    status, result = goals.result(goal)
    assert (status, result.cycles_completed) == (GoalStatus.STATUS_CANCELED, 1)
    assert result.message == 'cancelled after cycle 1 of 3; the machine stands at home'
    assert {trajectory.cycle for trajectory in stand_in.trajectories} == {1}


@pytest.mark.parametrize('event', [CycleEvent.REFUSED, CycleEvent.FAULT])
def test_refusal_or_fault_ends_the_goal_with_the_reason(graph, goals, stand_in, event):
    graph.start(TrajectoryGeneratorNode)
    goal = goals.send(motion=MOTION, cycles=3)
    stand_in.run(1)
    stand_in.start(2)
    stand_in.tell(event, 2, message='the door is open')
    status, result = goals.result(goal)
    assert (status, result.cycles_completed) == (GoalStatus.STATUS_ABORTED, 1)
    assert result.message == 'machine: the door is open'
    goal = goals.send(motion=MOTION)
    stand_in.run(3)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


def test_end_of_the_machine_process_in_a_cycle_ends_the_goal(graph, goals, stand_in):
    """The goal ends even if another machine has started before the graph reports the end of the first."""
    machine = graph.start(SilentMachine)
    graph.start(TrajectoryGeneratorNode)
    goal = goals.send(motion=MOTION, cycles=3)
    stand_in.run(1)
    stand_in.start(2)
    graph.next_event(CycleEvent.STARTED, cycle=2)
    graph.spin_in_silence()  # the generator has received it too
    graph.start(SilentMachine)  # before the graph reports the end of the first one
    graph.stop(machine)
    stop = graph.next_event(CycleEvent.STOP, cycle=2)
    assert stop.source == 'trajectory_generator'
    status, result = goals.result(goal)
    assert (status, result.cycles_completed) == (GoalStatus.STATUS_ABORTED, 1)
    assert result.message == f'cycle 2: {stop.message}'
    assert 'the machine that ran it is gone' in stop.message
    goal = goals.send(motion=MOTION)
    stand_in.run(3)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


def test_goal_waits_for_a_slow_machine(graph, goals, stand_in):
    graph.start(SilentMachine)
    graph.start(TrajectoryGeneratorNode)
    goal = goals.send(motion=MOTION)
    stand_in.start(1)
    looked_until = time.monotonic() + 2.5
    graph.spin_until(lambda: time.monotonic() > looked_until, 'two looks of the generator at the graph')
    stand_in.finish(1)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


def test_events_of_another_cycle_do_not_end_the_goal(graph, goals, stand_in):
    graph.start(TrajectoryGeneratorNode)
    goal = goals.send(motion=MOTION)
    stand_in.start(1)
    stand_in.tell(CycleEvent.FAULT, 7, message='somebody else')
    stand_in.finish(1)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED


def test_start_timeout_ends_the_goal_and_counts_the_subscribers(graph, goals, stand_in):
    graph.start(TrajectoryGeneratorNode, start_timeout=0.1)
    status, result = goals.result(goals.send(motion=MOTION))
    assert status == GoalStatus.STATUS_ABORTED
    assert result.message.startswith('cycle 1 did not start within 0.1 s; 1 node(s) listen to /pkm/pose_trajectory')


def test_late_generator_numbers_after_the_last_machine_cycle(graph, goals, stand_in):
    graph.publisher(UInt32, 'machine/cycle', LAST_VALUE_QOS).publish(UInt32(data=41))
    graph.start(TrajectoryGeneratorNode)
    graph.spin_in_silence()
    goal = goals.send(motion=MOTION)
    stand_in.run(42)
    assert goals.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
