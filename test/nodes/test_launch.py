"""
The launch file: its arguments, and that it starts the nodes of graph.py.

There is no package `launch` among the wheels that this project is set up from, so stand-ins of the same names record
what the file asks for. What a real `ros2 launch` did with it is in docs/launch.md.
"""

import re
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from pkm_core.config import find_config
from pkm_core.errors import ConfigError, PkmError
from pkm_nodes.graph import cell_nodes

FILE = Path(__file__).parents[2] / 'src' / 'pkm_nodes' / 'launch' / 'cell.launch.py'


class DeclareLaunchArgument(SimpleNamespace):
    def __init__(self, name, **given):
        super().__init__(name=name, **given)


class LaunchConfiguration:
    def __init__(self, name):
        self.name = name

    def perform(self, context):
        return context[self.name]


@pytest.fixture
def launch(monkeypatch):
    """Return a function: the nodes that the launch file starts with the given arguments, each as its keywords."""
    modules = {
        'launch': {'LaunchDescription': list},
        'launch.actions': {
            'DeclareLaunchArgument': DeclareLaunchArgument,
            'OpaqueFunction': SimpleNamespace,
        },
        'launch.substitutions': {'LaunchConfiguration': LaunchConfiguration},
        'launch_ros': {},
        'launch_ros.actions': {'Node': SimpleNamespace},
    }
    for name, content in modules.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
    *arguments, action = runpy.run_path(str(FILE))['generate_launch_description']()
    defaults = {argument.name: argument.default_value for argument in arguments}

    def start(**given):
        assert given.keys() <= defaults.keys()
        return action.function(defaults | given)

    return start


def test_composed_cell_is_one_process_with_the_arguments(launch):
    (node,) = launch(machine='planar', seed='7', environment='hard', namespace='left')
    assert (node.package, node.executable, node.namespace) == ('pkm_nodes', 'cell', '/left')
    wanted = {'machine': 'planar', 'seed': 7, 'environment': 'hard', 'folder': 'bags', 'use_sim_time': True}
    assert wanted.items() <= node.parameters[0].items()
    assert node.remappings == [('/clock', '/left/clock')]


def test_processes_are_the_nodes_of_the_graph(launch):
    nodes = launch(machine='planar', arrangement='processes', folder='here')
    specs = cell_nodes('planar', folder='here')
    assert [(node.executable, node.name or node.executable) for node in nodes] == [
        (s.executable, s.name) for s in specs
    ]
    session = nodes[0].parameters[0]['session']
    assert session
    assert launch(machine='planar')[0].parameters[0]['session'] != session
    for node, spec in zip(nodes, specs, strict=True):
        assert node.parameters == [{'use_sim_time': True, 'session': session, **spec.parameters}]
        assert (node.namespace, node.remappings) == ('/pkm', [])


BUILT = """
built:
  specimen: {machine: planar, origin: simulated, seed: 3, environment: hard}
  l2: 70.01 mm
  l4: 69.99 mm
  dy: 10 mm
  marks: {d1: 0 mm, d3: 0 mm}
"""


def test_calibrated_machine_of_another_specimen_has_no_cell(tmp_path):
    drawing = find_config('machines', 'planar').read_text()
    path = tmp_path / 'planar.yaml'
    path.write_text(drawing + BUILT)
    assert cell_nodes(path, seed=3, environment='hard')
    for cell in ({'seed': 4, 'environment': 'hard'}, {'seed': 3}):
        with pytest.raises(
            ConfigError, match='of specimen planar, seed 3, environment hard; the machine in use is planar'
        ):
            cell_nodes(path, **cell)
    assert cell_nodes(path, without=['machine'])  # another node than the simulated machine is not checked


def test_nodes_left_out_are_not_started(launch):
    nodes = launch(machine='planar', arrangement='processes', without='joint_controller_d1, machine')
    names = [node.name or node.executable for node in nodes]
    assert 'joint_controller_d3' in names
    assert not {'joint_controller_d1', 'machine'} & set(names)
    (cell,) = launch(machine='planar', without='joint_controller_d1,machine')
    assert cell.parameters[0]['without'] == 'joint_controller_d1,machine'
    assert 'without' not in launch()[0].parameters[0]


def test_unknown_node_cannot_be_left_out(launch):
    with pytest.raises(PkmError, match=r"without: no node of this cell is called \['d3'\]; known: \['machine', "):
        launch(arrangement='processes', without='d3')


def test_invalid_namespace_is_refused(launch):
    with pytest.raises(PkmError, match="namespace: 'a b' given"):
        launch(namespace='a b')


@pytest.mark.parametrize('arrangement', ['composed', 'processes'])
def test_pace_and_time_reach_the_machine(launch, arrangement):
    node = launch(arrangement=arrangement, pace='1', time='continuous')[0]
    assert {'pace': 1.0, 'time': 'continuous'}.items() <= node.parameters[0].items()


@pytest.mark.parametrize('pace', ['fast', 'nan', '-1', '0.001', ''])
def test_invalid_pace_is_refused_with_its_range(launch, pace):
    with pytest.raises(PkmError, match=r'pace: .* given; allowed: 0 \(as fast as possible\), or 0.01 to 1000'):
        launch(pace=pace)


@pytest.mark.parametrize('seed', ['x', '-1', '1.5', ''])
def test_seed_must_be_a_whole_number(launch, seed):
    with pytest.raises(PkmError, match=re.escape(f"seed: '{seed}' given; expected an integer, 0 or more")):
        launch(seed=seed)
