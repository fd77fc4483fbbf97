"""The whole cell in one process: the nodes of graph.py around one machine, in one lock-step executor."""

from rclpy.parameter import Parameter

from pkm_core.errors import ConfigError
from pkm_core.servo.pace import PACE, TIME
from pkm_core.start import seconds_since_start
from pkm_nodes.graph import ENVIRONMENTS, WITHOUT, cell_nodes, learning_target, names_in
from pkm_nodes.nodes.calibration import CalibrationNode
from pkm_nodes.nodes.computed_torque_controller import ComputedTorqueControllerNode
from pkm_nodes.nodes.identification import IdentificationNode
from pkm_nodes.nodes.inverse_kinematics import InverseKinematicsNode
from pkm_nodes.nodes.joint_controller import JointControllerNode
from pkm_nodes.nodes.learning import LearningNode
from pkm_nodes.nodes.machine import MachineNode
from pkm_nodes.nodes.recorder import RecorderNode
from pkm_nodes.nodes.state_estimator import StateEstimatorNode
from pkm_nodes.nodes.tool_learning import ToolLearningNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.runtime.node import PLUGINS, PkmNode, entry_point
from pkm_nodes.runtime.parameter_sources import place_of
from pkm_nodes.runtime.session import new_session

NODES = {
    'machine': MachineNode,
    'trajectory_generator': TrajectoryGeneratorNode,
    'inverse_kinematics': InverseKinematicsNode,
    'joint_controller': JointControllerNode,
    'computed_torque_controller': ComputedTorqueControllerNode,
    'state_estimator': StateEstimatorNode,
    'learning': LearningNode,
    'tool_learning': ToolLearningNode,
    'identification': IdentificationNode,
    'calibration': CalibrationNode,
    'recorder': RecorderNode,
}


class CellNode(PkmNode):
    """Parameters of the composed cell."""

    def __init__(self, **kwargs):
        super().__init__('cell', known_elsewhere=None, **kwargs)
        self.session = self.session or new_session()
        self.specs = cell_nodes(
            self.machine_setting(),
            control=self.control_setting(),
            seed=self.setting('seed', 1, 'seed of everything random in the machine'),
            environment=self.setting('environment', 'nominal', ENVIRONMENTS),
            folder=self.setting('folder', 'bags', "folder of the recorder's bags"),
            record=self.setting('record', True, 'run a recorder, and let the machine wait for it'),
            without=names_in(self.setting('without', '', WITHOUT)),
            plugins=self.setting('plugins', '', PLUGINS),
            learned=self.setting('learned', '', 'folder in which learning/save may write; by default beside folder'),
            learning_target=learning_target(self),
            pace=self.setting('pace', 0.0, f'{PACE}; of the machine at its start'),
            time=self.setting('time', 'standing', TIME),
        )


def make_cell():
    """
    Return all nodes of the cell; the recorder taps those before it.

    A parameter of any node may be given to all (``-p answer_timeout:=10.0``, ``/**:``) or in the section of that node.
    `ConfigError` if no node declares it, or a section contradicts the cell.
    """
    nodes = [CellNode()]
    try:
        for spec in nodes[0].specs:
            node = _made(spec, nodes)
            nodes += [node, *getattr(node, 'parts', [])]
        declared = frozenset().union(*(node.declared() for node in nodes))
        for node in nodes:
            node.check_given(declared)
    except Exception:
        for node in nodes:
            node.destroy_node()
        raise
    return nodes


def _made(spec, nodes):
    """Return the node of `spec` of the cell `nodes`, whose first is the `CellNode`."""
    cell = nodes[0]
    use_sim_time = cell.get_parameter('use_sim_time').value
    parameters = {'use_sim_time': use_sim_time, 'session': cell.session, **spec.parameters}
    named = {} if spec.name == spec.executable else {'name': spec.name}
    if spec.executable == 'recorder':
        named['neighbours'] = nodes
    overrides = [Parameter(key, value=value) for key, value in parameters.items()]
    node = NODES[spec.executable](parameter_overrides=overrides, known_elsewhere=None, **named)
    try:
        _refuse_contradiction(node, cell, parameters)
    except ConfigError:
        for each in (node, *getattr(node, 'parts', [])):
            each.destroy_node()
        raise
    return node


def _refuse_contradiction(node, cell, parameters):
    """Refuse a parameter that the command line gives to `node` alone and that the `cell` sets in its `parameters`."""
    name_of_node = node.get_fully_qualified_name()
    for name, value in parameters.items():
        own = node.given.get(name, value)
        if own != value and own != cell.given.get(name):
            raise ConfigError(
                f'{name_of_node}: {name} is {own!r}{place_of(name, name_of_node)}; the cell sets {value!r}; give '
                f'{name} to {cell.get_fully_qualified_name()}, or to all nodes'
            )


def _make_and_say():
    """Return all nodes of the cell, and print in one line that it is up."""
    nodes = make_cell()
    cell = nodes[0]
    machine, domain = cell.get_parameter('machine').value, cell.context.get_domain_id()
    where = f'machine {machine}, namespace {cell.get_namespace()}, ROS domain {domain}'
    print(f'cell is up: {where}, {seconds_since_start():.1f} s after its start; Ctrl-C ends it', flush=True)
    return nodes


main = entry_point(_make_and_say)
