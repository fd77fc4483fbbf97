"""Parameters of the composed cell: by `-p`, for all nodes, in a node's own section; taken whole, or refused by name."""

import re
import sys

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions

from pkm_core.errors import ConfigError
from pkm_nodes.nodes.cell import CellNode, _make_and_say, make_cell

ALL = '/**:\n  ros__parameters: {machine: planar, record: false'


@pytest.fixture
def start(domain_id, monkeypatch, tmp_path):
    """Return a function that makes nodes under a command line; `FILE` in it stands for a file with `text`."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    made = []

    def start(make, *words, text=''):
        (tmp_path / 'p.yaml').write_text(text)
        words = [str(tmp_path / 'p.yaml') if word == 'FILE' else word for word in words]
        monkeypatch.setattr(sys, 'argv', ['cell', '--ros-args', *words])
        options = {'domain_id': domain_id, 'signal_handler_options': SignalHandlerOptions.NO}
        rclpy.init(args=sys.argv, **options)
        nodes = make()
        made.extend(nodes if isinstance(nodes, list) else [nodes])
        return {node.get_name(): node for node in made}

    yield start
    for node in made:
        node.destroy_node()
    rclpy.shutdown()


def value(nodes, node, name):
    return nodes[node].get_parameter(name).value


def test_parameter_of_a_node_may_be_given_to_all(start):
    """As documented: `-p` and `/**:` reach every node; only the machine has answer_timeout."""
    nodes = start(make_cell, '-p', 'answer_timeout:=10.0', '--params-file', 'FILE', text=f'{ALL}, seed: 7}}\n')
    assert value(nodes, 'machine', 'answer_timeout') == 10.0
    assert value(nodes, 'machine', 'seed') == 7
    assert not nodes['inverse_kinematics'].has_parameter('answer_timeout')


def test_cell_prints_in_one_line_that_it_is_up(start, capsys, domain_id):
    start(_make_and_say, '-r', '__ns:=/left', '-p', 'machine:=planar', '-p', 'record:=false')
    said = capsys.readouterr().out
    where = f'machine planar, namespace /left, ROS domain {domain_id}'
    assert re.fullmatch(rf'cell is up: {where}, \d+\.\d s after its start; Ctrl-C ends it\n', said)


def test_section_of_a_node_is_taken(start):
    text = (
        f'{ALL}}}\n/pkm/machine:\n  ros__parameters: {{answer_timeout: 7.0}}\n/other/node:\n  ros__parameters: {{x: 1}}'
    )
    nodes = start(make_cell, '--params-file', 'FILE', text=text)
    assert value(nodes, 'machine', 'answer_timeout') == 7.0


def test_section_that_contradicts_the_cell_is_refused(start):
    text = f'{ALL}}}\n/pkm/machine:\n  ros__parameters: {{seed: 7}}\n'
    with pytest.raises(
        ConfigError, match=r'/pkm/machine: seed is 7 \(.*p.yaml, section /pkm/machine\); the cell sets 1'
    ):
        start(make_cell, '--params-file', 'FILE', text=text)


def test_misspelt_parameter_of_a_section_is_refused(start):
    text = f'{ALL}}}\n/pkm/machine:\n  ros__parameters: {{answer_timeuot: 7.0}}\n'
    with pytest.raises(ConfigError, match=r"\['answer_timeuot'\] \(.*p.yaml, section /pkm/machine\); known:"):
        start(make_cell, '--params-file', 'FILE', text=text)


def test_foreign_parameter_for_any_node_is_left_to_others(start, capfd):
    """A file of a whole robot has parameters of other packages in `/**`."""
    nodes = start(make_cell, '--params-file', 'FILE', text=f'{ALL}, robot_description: "<robot/>"}}\n')
    assert value(nodes, 'machine', 'machine') == 'planar'
    assert 'robot_description' in capfd.readouterr().err


@pytest.mark.parametrize(
    ('text', 'seed'),
    [
        ('pkm:\n  cell:\n    ros__parameters: {machine: planar, record: no, seed: 5}\n', 5),
        ('/pkm:\n  cell:\n    ros__parameters: {machine: planar, record: off}\n', 1),
        ('cell:\n  ros__parameters: {machine: planar, seed: 6}\n', 1),
        ('/*/cell:\n  ros__parameters: {machine: planar, seed: 7, record: False}\n', 7),
    ],
)
def test_nested_namespaces_and_truth_values_are_those_of_ros(start, text, seed):
    """A section `cell` is for /cell, not for /pkm/cell; `no` and `off` are false."""
    nodes = start(CellNode, '--params-file', 'FILE', text=text)
    assert value(nodes, 'cell', 'seed') == seed
    assert value(nodes, 'cell', 'record') == (seed == 1 and 'off' not in text)


@pytest.mark.parametrize(
    ('parameter', 'reason'),
    [
        ('seed: 7.0', r'/pkm/cell: seed is 7\.0 \(double\) \(.*p.yaml, section /\*\*\); expected integer'),
        ('machine: yes', r'/pkm/cell: machine is True \(bool\) \(.*p.yaml, section /\*\*\); expected string'),
        ('record: 1', r'/pkm/cell: record is 1 \(integer\) \(.*p.yaml, section /\*\*\); expected bool'),
    ],
)
def test_value_of_another_type_is_refused_with_file_node_and_key(start, parameter, reason):
    with pytest.raises(ConfigError, match=reason):
        start(CellNode, '--params-file', 'FILE', text=f'/**:\n  ros__parameters: {{{parameter}}}\n')
