"""
The launch files: their arguments, the nodes of graph.py, and RViz with the layout of a cell.

There is no package `launch` among the wheels that this project is set up from, so stand-ins of the same names record
what the file asks for. What a real `ros2 launch` did with it is in docs/launch.md.
"""

import re
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
import yaml

from pkm_core.config import find_config
from pkm_core.errors import ConfigError, PkmError
from pkm_nodes.graph import cell_nodes

SHARE = Path(__file__).parents[2] / 'src' / 'pkm_nodes'


class DeclareLaunchArgument(SimpleNamespace):
    def __init__(self, name, **given):
        super().__init__(name=name, **given)


class LaunchConfiguration:
    def __init__(self, name):
        self.name = name

    def perform(self, context):
        return context[self.name]


@pytest.fixture
def load(monkeypatch):
    """Return a function: what a launch file starts with given arguments, each node as its keywords."""
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

    def load_file(name):
        *arguments, action = runpy.run_path(str(SHARE / 'launch' / name))['generate_launch_description']()
        defaults = {argument.name: argument.default_value for argument in arguments}

        def start(**given):
            assert given.keys() <= defaults.keys()
            return action.function(defaults | given)

        return start

    return load_file


@pytest.fixture
def launch(load):
    return load('cell.launch.py')


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


@pytest.mark.parametrize(
    ('namespace', 'prefix', 'clock'), [('pkm', '', []), ('line/left', 'line/left/', [('/clock', '/line/left/clock')])]
)
def test_rviz_shows_the_model_and_frames_of_the_cell(load, namespace, prefix, clock):
    (rviz,) = load('display.launch.py')(namespace=namespace)
    assert (rviz.package, rviz.remappings, rviz.parameters) == ('rviz2', clock, [{'use_sim_time': True}])
    file = Path(rviz.arguments[1])
    manager = yaml.safe_load(file.read_text(encoding='utf-8'))['Visualization Manager']
    if prefix:
        file.unlink()
    shown = {display['Name']: display for display in manager['Displays']}
    assert manager['Global Options']['Fixed Frame'] == f'{prefix}base_link'
    assert shown['Machine']['TF Prefix'] == prefix.rstrip('/')
    topic = shown['Machine']['Description Topic']
    assert (topic['Value'], topic['Durability Policy']) == (f'/{namespace}/robot_description', 'Transient Local')
    assert shown['Pose']['Topic']['Value'] == f'/{namespace}/pose'


def test_analyzers_select_every_diagnosed_node_once():
    """diagnostic_aggregator compares the begin of a name; what fits no analyzer is listed as `Other`."""
    file = SHARE / 'layouts' / 'diagnostics.yaml'
    groups = yaml.safe_load(file.read_text(encoding='utf-8'))['analyzers']['ros__parameters']
    begins = [begin for group in groups.values() if isinstance(group, dict) for begin in group['startswith']]
    names = [spec.name for control in ('robust', 'computed_torque') for spec in cell_nodes('four_dof', control=control)]
    silent = {'trajectory_generator', 'inverse_kinematics', 'learning', 'identification', 'calibration'}
    for name in set(names) - silent:
        assert sum(f'/pkm/{name}: state'.startswith(begin) for begin in begins) == 1, name
