"""Pieces of a jog behind the trajectory generator: the machine waits for them, controllers drive them."""

import numpy as np
import pytest
from std_srvs.srv import Trigger

from pkm_core.control.feasibility import drive_check
from pkm_core.control.model import load_model
from pkm_core.motion.jog import JogPlanner
from pkm_core.motion.pieces import joined
from pkm_core.motion.trajectory import to_joints
from pkm_interfaces.msg import CycleError, CycleEvent, EncoderSample, MotorCommand, SampledTrajectory
from pkm_nodes.messages.conversions import trajectory_to_msg
from pkm_nodes.nodes.computed_torque_controller import ComputedTorqueControllerNode
from pkm_nodes.nodes.joint_controller import JointControllerNode
from pkm_nodes.nodes.machine import MachineNode

JOINTS = ('d1', 'd3', 'd5', 'd7')


# the machine


def test_machine_extends_the_cycle_by_a_piece_of_all_joints(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 6, hold=2)
    controllers.run(0, 2)
    graph.spin_in_silence()
    controllers.load_only(1, 8, hold=4)
    controllers.wait_for(2, EncoderSample.EXTENDED)
    extended = graph.next_event(CycleEvent.EXTENDED)
    assert (extended.source, extended.cycle, extended.samples, extended.tick) == ('machine', 1, 8, 2)
    controllers.answer(2)
    controllers.run(3, 5)  # no further piece: it drives the rest of the last one
    assert graph.next_event(CycleEvent.FINISHED).samples == 8


def test_stop_service_ends_a_jog_that_waits_for_a_piece(graph, controllers):
    graph.start(MachineNode)
    controllers.load(1, 6, hold=2)
    controllers.run(0, 2)
    graph.spin_in_silence()  # until the machine has the last answer
    assert graph.call(Trigger, 'machine/stop').success
    fault = graph.next_event(CycleEvent.FAULT)
    assert (fault.cycle, fault.samples, fault.message) == (1, 2, 'stopped by the service machine/stop')


# the controllers


class Jog:
    """The test in the place of inverse kinematics and machine."""

    def __init__(self, graph, machine):
        self._graph = graph
        planner = JogPlanner(machine, machine.home, drive_check(machine, load_model(machine)))
        self.pieces = [planner.next(np.array([0.0, 0.0, part * 0.002, 0.0])) for part in (0, 1, -1)]
        self.joints = [to_joints(machine, piece.poses) for piece in self.pieces]
        self.commands = {joint: graph.listen(MotorCommand, f'{joint}/command') for joint in JOINTS}
        self._trajectories = graph.publisher(SampledTrajectory, 'joint_trajectory')
        self._encoders = {joint: graph.publisher(EncoderSample, f'{joint}/encoder') for joint in JOINTS}

    def send(self, number, **changes):
        piece, named = self.pieces[number], {'cycle': 1, 'motion': 'jog', 'stay': True}
        message = trajectory_to_msg(self.joints[number], **named, offset=piece.offset, hold=piece.hold)
        for name, value in changes.items():
            setattr(message, name, value)
        self._trajectories.publish(message)

    def load(self, number, joints):
        self.send(number)
        for joint in joints:
            event = self._graph.next_event(CycleEvent.LOADED, source=joint, samples=self.pieces[number].samples)
            assert (event.cycle, event.hold) == (1, self.pieces[number].hold)

    def drive(self, reference, begin, end, joints, mode=EncoderSample.RUN):
        """Run the samples `begin` to `end` on their reference, the first one with `mode`; return the errors."""
        errors = []
        for index in range(begin, end):
            for column, joint in enumerate(JOINTS):
                position = float(reference[index, column])
                sample = {'tick': index, 'cycle': 1, 'index': index, 'position': position}
                self._encoders[joint].publish(EncoderSample(**sample, mode=mode if index == begin else 0))
            heard = [self.commands[joint] for joint in joints]
            self._graph.spin_until(lambda heard=heard: all(heard), f'the commands of sample {index}')
            errors += [each.pop().error for each in heard]
        return errors


@pytest.fixture
def jog(graph, machine):
    return Jog(graph, machine)


@pytest.mark.parametrize(
    ('node', 'named', 'joints'),
    [
        (JointControllerNode, {'joint': 'd3'}, ('d3',)),
        (JointControllerNode, {'joint': 'd3', 'control': 'observer'}, ('d3',)),
        (ComputedTorqueControllerNode, {}, JOINTS),
    ],
    ids=['robust', 'observer', 'computed torque'],
)
def test_controller_drives_each_piece_from_its_first_sample(graph, jog, node, named, joints):
    """The piece after the second one is loaded, but the machine does not use it."""
    graph.start(node, **named)
    errors = graph.listen(CycleError, f'{joints[0]}/cycle_error')
    whole = joined(jog.joints[0], jog.pieces[1].offset, jog.joints[1]).position
    hold = jog.pieces[0].hold
    jog.load(0, joints)
    assert not any(jog.drive(whole, 0, hold - 5, joints))
    jog.load(1, joints)
    assert not any(jog.drive(whole, hold - 5, hold, joints))
    assert not any(jog.drive(whole, hold, hold + 30, joints, EncoderSample.EXTENDED))
    jog.load(2, joints)
    assert not any(jog.drive(whole, hold + 30, len(whole), joints))
    graph.spin_until(lambda: errors, 'the errors of the whole cycle')
    assert len(errors[0].error) == len(whole)


@pytest.mark.parametrize(
    ('node', 'named', 'joints'),
    [(JointControllerNode, {'joint': 'd3'}, ('d3',)), (ComputedTorqueControllerNode, {}, JOINTS)],
    ids=['robust', 'computed torque'],
)
def test_piece_that_overtakes_the_tick_before_it_is_kept(graph, jog, node, named, joints):
    """The messages of two topics may be read in another order than they were sent in."""
    graph.start(node, **named)
    first, second, third = (piece.offset for piece in jog.pieces)
    whole = joined(joined(jog.joints[0], second, jog.joints[1]), third, jog.joints[2]).position
    for number in range(3):
        jog.load(number, joints)
    assert not any(jog.drive(whole, first, second, joints))
    assert not any(jog.drive(whole, second, third, joints, EncoderSample.EXTENDED))
    assert not any(jog.drive(whole, third, len(whole), joints, EncoderSample.EXTENDED))


def test_controller_refuses_a_piece_with_a_jump(graph, jog):
    """The machine then drives the stop of the piece before; nothing ends the cycle earlier."""
    graph.start(JointControllerNode, joint='d3')
    jog.load(0, ('d3',))
    jog.drive(jog.joints[0].position, 0, 2, ('d3',))
    jumped = (jog.joints[1].position + 1e-3).ravel().tolist()
    jog.send(1, position=jumped)
    notice = graph.next_event(CycleEvent.NOTICE, source='d3').message
    assert notice.startswith('jog: trajectory: d1 at sample 1 to the next moves at ')
    assert not any(jog.drive(jog.joints[0].position, 2, 60, ('d3',)))
    assert not [event for event in graph.events if event.event == CycleEvent.REFUSED]


def test_piece_that_does_not_begin_at_the_hold_is_ignored(graph, jog):
    graph.start(JointControllerNode, joint='d3')
    jog.load(0, ('d3',))
    jog.send(1, offset=jog.pieces[1].offset + 1)
    jog.send(1, cycle=2)
    graph.spin_in_silence()
    assert not [event for event in graph.events if event.event == CycleEvent.LOADED]
    jog.load(1, ('d3',))
