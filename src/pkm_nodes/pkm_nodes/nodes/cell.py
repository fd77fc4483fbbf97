"""The whole cell in one process: the nodes of graph.py around one machine, in one lock-step executor."""

from rclpy.parameter import Parameter

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
        super().__init__('cell', **kwargs)
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
        )
        self.check_settings()


def make_cell():
    """Return all nodes of the cell; the recorder taps those before it."""
    nodes = [CellNode()]
    use_sim_time = nodes[0].get_parameter('use_sim_time').value
    for spec in nodes[0].specs:
        parameters = {'use_sim_time': use_sim_time, 'session': nodes[0].session, **spec.parameters}
        named = {} if spec.name == spec.executable else {'name': spec.name}
        if spec.executable == 'recorder':
            named['neighbours'] = nodes
        overrides = [Parameter(key, value=value) for key, value in parameters.items()]
        node = NODES[spec.executable](parameter_overrides=overrides, known_elsewhere=nodes[0].declared(), **named)
        nodes += [node, *getattr(node, 'parts', [])]
    return nodes


main = entry_point(make_cell)
