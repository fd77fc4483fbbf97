"""The services reload: a running node applies the present configuration, or refuses it with the reason."""

import re
import shutil

import numpy as np
import pytest
from std_srvs.srv import Trigger

from pkm_core.config import Configuration
from pkm_core.control.forces import coupling_voltage
from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustController, load_control
from pkm_core.machines import load_machine
from pkm_interfaces.msg import CycleEvent, EncoderSample, MotorCommand, SampledTrajectory
from pkm_nodes.messages.conversions import trajectory_from_msg
from pkm_nodes.nodes.joint_controller import JointControllerNode
from pkm_nodes.nodes.learning import LearningNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode

COLUMN = 1  # d3


@pytest.fixture
def config(tmp_path, monkeypatch):
    """Return a copy of the configuration that the nodes of the test read."""
    folder = shutil.copytree(Configuration.of_environment().folder, tmp_path / 'config')
    monkeypatch.setenv('PKM_CONFIG', str(folder))
    return folder


@pytest.fixture
def configured(config):
    """Return the machine with that configuration."""
    return load_machine('four_dof')


def scale(file, key, factor):
    """Multiply every value of `key` in a YAML file."""
    text = file.read_text()
    changed = re.sub(rf'({key}: )([\d.]+)', lambda found: f'{found[1]}{factor * float(found[2]):.9g}', text)
    assert changed != text
    file.write_text(changed)


def test_reload_applies_the_present_model_and_gains(graph, configured, config, joint_trajectory):
    node = graph.start(JointControllerNode, joint='d3')
    scale(config / 'model' / 'four_dof.yaml', 'gain', 0.9)
    scale(config / 'control' / 'four_dof.yaml', 'kp', 1.02)
    answer = graph.call(Trigger, 'd3/reload')
    assert answer.success, answer.message
    gains, model = load_control(configured)['d3'], load_model(configured)['d3']
    assert node.get_parameter('kp').value == gains.kp

    law = RobustController(gains, model, configured.sample_time, configured.voltage_limit)
    message = joint_trajectory(1)
    rows = [np.array(getattr(message, name)).reshape(-1, 4)[:, COLUMN]
            for name in ('position', 'velocity', 'acceleration', 'jerk')]  # fmt: skip
    law.load(*rows, np.zeros(len(rows[0])))
    commands = graph.listen(MotorCommand, 'd3/command')
    samples = graph.publisher(EncoderSample, 'd3/encoder')
    graph.publisher(SampledTrajectory, 'joint_trajectory').publish(message)
    graph.next_event(CycleEvent.LOADED, cycle=1)
    for index, reference in enumerate(rows[0]):
        samples.publish(EncoderSample(tick=index, cycle=1, index=index, position=reference - 1e-6))
        graph.spin_until(lambda: commands, 'a command')
        assert commands.pop().voltage == law.update(index, reference - 1e-6)[0]


def test_reload_applies_identified_forces(graph, configured, config, joint_trajectory):
    """The commands are those of the core, with the coupling of the other joints' motion."""
    graph.start(JointControllerNode, joint='d3')
    file = config / 'model' / 'four_dof.yaml'
    forces = 'forces: {coulomb: 0.05 V, slip: 10 um, coupling: 1, cogging_sine: 5 mV}'
    file.write_text(file.read_text().replace('  d5:\n', f'    {forces}\n  d5:\n'))
    answer = graph.call(Trigger, 'd3/reload')
    assert answer.success, answer.message
    gains, model = load_control(configured)['d3'], load_model(configured)['d3']
    law = RobustController(gains, model, configured.sample_time, configured.voltage_limit)
    message = joint_trajectory(1)
    trajectory = trajectory_from_msg(message, coordinates=configured.joints, sample_time=configured.sample_time)
    rows = [values[:, COLUMN] for values in trajectory.derivatives()]
    law.load(*rows, np.zeros(len(rows[0])), coupling_voltage(configured, trajectory, COLUMN))
    commands = graph.listen(MotorCommand, 'd3/command')
    samples = graph.publisher(EncoderSample, 'd3/encoder')
    graph.publisher(SampledTrajectory, 'joint_trajectory').publish(message)
    graph.next_event(CycleEvent.LOADED, cycle=1)
    for index, reference in enumerate(rows[0]):
        samples.publish(EncoderSample(tick=index, cycle=1, index=index, position=reference))
        graph.spin_until(lambda: commands, 'a command')
        assert commands.pop().voltage == law.update(index, reference)[0]


def test_reload_of_gains_without_margin_keeps_the_old_gains(graph, config):
    node = graph.start(JointControllerNode, joint='d3')
    before = node.get_parameter('kp').value
    scale(config / 'model' / 'four_dof.yaml', 'gain', 1.5)
    answer = graph.call(Trigger, 'd3/reload')
    assert not answer.success
    assert 'the loop has gain margin' in answer.message
    assert node.get_parameter('kp').value == before
    scale(config / 'model' / 'four_dof.yaml', 'gain', 1 / 1.5)
    assert graph.call(Trigger, 'd3/reload').success


@pytest.mark.parametrize(
    ('node_type', 'service'),
    [(LearningNode, 'learning/reload'), (TrajectoryGeneratorNode, 'trajectory_generator/reload')],
)
def test_reload_of_an_invalid_configuration_is_refused(graph, config, node_type, service):
    graph.start(node_type)
    assert graph.call(Trigger, service).success
    (config / 'control' / 'four_dof.yaml').write_text('joints: {}\n')
    answer = graph.call(Trigger, service)
    assert not answer.success
    assert 'four_dof has' in answer.message
