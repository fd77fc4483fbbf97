"""Simulated time between cycles: it stands, or runs on; the test replaces the joint controllers."""

from time import monotonic

import numpy as np
import pytest
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

from pkm_core.errors import PkmError
from pkm_interfaces.msg import CycleEvent, LaserSample
from pkm_nodes.nodes.machine import MachineNode
from pkm_nodes.runtime.node import PkmNode
from support.controllers import IN_TIME


class Timed(PkmNode):
    """A user's node with a timer in simulated time."""

    def __init__(self, **kwargs):
        super().__init__('timed', **kwargs)
        self.calls = 0
        self.create_timer(0.05, self._on_timer)

    def _on_timer(self):
        self.calls += 1


def nanoseconds(clock):
    return [1_000_000_000 * each.clock.sec + each.clock.nanosec for each in clock]


def test_timer_in_simulated_time_stands_with_the_machine(graph):
    graph.start(MachineNode)
    timed = graph.start(Timed, use_sim_time=True)
    graph.spin_in_silence()
    assert timed.calls == 0


def test_timer_in_simulated_time_fires_while_the_machine_stands(graph):
    graph.start(MachineNode, time='continuous', pace=10.0)
    timed = graph.start(Timed, use_sim_time=True)
    graph.spin_until(lambda: timed.calls >= 5, 'calls of the timer')


def test_time_at_rest_has_the_pace_of_the_machine(graph):
    graph.start(MachineNode, time='continuous', pace=0.5)
    clock = graph.listen(Clock, '/clock', qos_profile_sensor_data)
    graph.spin_until(lambda: clock, 'the clock')
    begun, first = monotonic(), nanoseconds(clock)[-1]
    graph.spin_until(lambda: len(clock) > 40, 'the clock')
    assert nanoseconds(clock)[-1] - first <= 0.5e9 * (monotonic() - begun) + 20e6  # of one message on its way


def test_paused_machine_has_no_time_at_rest(graph):
    graph.start(MachineNode, time='continuous')
    graph.call(SetBool, 'machine/pause', SetBool.Request(data=True))
    clock = graph.listen(Clock, '/clock', qos_profile_sensor_data)
    graph.spin_until(lambda: len(clock) > 2, 'the clock')
    graph.spin_in_silence()
    assert len(set(nanoseconds(clock))) == 1


@pytest.fixture
def cycles(graph, controllers):
    """Return a function that runs two cycles and a reset with a rest before each; it returns what was measured."""

    def run(time):
        machine = graph.start(MachineNode, time=time, answer_timeout=IN_TIME)
        laser, clock = graph.listen(LaserSample, 'laser'), graph.listen(Clock, '/clock', qos_profile_sensor_data)
        firsts = []
        for cycle in (1, 2, 3):
            graph.spin_in_silence()
            if cycle == 3:
                graph.call(Trigger, 'machine/reset')
            controllers.load(cycle, 30)
            firsts.append(graph.next_event(CycleEvent.STARTED, cycle=cycle).tick)
            controllers.run(firsts[-1], 30, 0.5)
            graph.next_event(CycleEvent.FINISHED, cycle=cycle)
        graph.spin_in_silence()
        counts = controllers.counts()
        for heard in controllers.samples.values():
            heard.clear()
        graph.stop(machine)
        return counts, firsts, list(laser), nanoseconds(clock)

    return run


def test_cycles_do_not_depend_on_the_time_at_rest(cycles):
    """Counts and laser have the same bits; only their times differ, by whole steps of 0.1 s."""
    counts, firsts, laser, _ = cycles('standing')
    later, later_firsts, later_laser, clock = cycles('continuous')
    assert firsts == [0, 30, 60]
    assert later == counts
    assert [list(each.displacement) for each in later_laser] == [list(each.displacement) for each in laser]
    shifts = np.array(later_firsts) - firsts
    assert (shifts % 200 == 0).all()
    assert (np.diff(shifts) > 0).all()
    assert shifts[0] > 0
    times = np.array([[each.time for each in part] for part in (laser, later_laser)])
    assert sorted({round(shift / 0.5e-3) for shift in times[1] - times[0]}) == shifts.tolist()
    assert clock == sorted(clock), 'time never steps back'


def test_unknown_policy_of_time_is_refused(graph):
    with pytest.raises(PkmError, match="/pkm/machine: time: 'real' given; allowed: standing, continuous"):
        graph.start(MachineNode, time='real')
