"""Who runs in a cell: the one list that the composed cell, `pkm run` and the launch file start their nodes from."""

from dataclasses import dataclass, field
from pathlib import Path

from pkm_core.machines import load_machine

# what the parameter and the options of this name say of themselves
ENVIRONMENTS = 'how rough the world is: ideal, nominal, hard, elastic (four_dof) or another section of config/truth'


@dataclass(frozen=True)
class NodeSpec:
    """One process of the cell when it is spread out: an executable of pkm_nodes, its node name and parameters."""

    executable: str
    name: str
    parameters: dict = field(default_factory=dict)

    def arguments(self, common):
        """Return the command-line arguments that start this node with its and the `common` parameters."""
        parameters = {**common, **self.parameters}
        settings = [word for key, value in parameters.items() for word in ('-p', f'{key}:={_yaml(value)}')]
        # only where it differs: __node renames every node of a process, and the machine's has six
        rename = [] if self.name == self.executable else ['-r', f'__node:={self.name}']
        return ['--ros-args', *rename, *settings]


def _yaml(value):
    return str(value).lower() if isinstance(value, bool) else str(value)


def cell_nodes(machine, *, seed=1, environment='nominal', folder='', record=True):
    """
    Return the `NodeSpec`s of a whole cell around `machine` (name or file).

    `seed` and `environment` go to the simulated machine, `folder` takes the recorder's bags, and a folder `identified`
    beside it models and pictures; without `record` there is no recorder and the machine does not wait for one.
    """
    on_machine = {'machine': str(machine)}
    nodes = [
        NodeSpec(
            'machine',
            'machine',
            {**on_machine, 'seed': seed, 'environment': environment, 'wait_for_recorder': record},
        ),
        NodeSpec('trajectory_generator', 'trajectory_generator', on_machine),
        NodeSpec('inverse_kinematics', 'inverse_kinematics', on_machine),
        *(
            NodeSpec('joint_controller', f'joint_controller_{joint}', {**on_machine, 'joint': joint})
            for joint in load_machine(machine).joints
        ),
        NodeSpec('state_estimator', 'state_estimator', on_machine),
        NodeSpec('learning', 'learning', on_machine),
        NodeSpec('identification', 'identification', {**on_machine, 'folder': str(Path(folder).parent / 'identified')}),
    ]
    if record:
        nodes.append(NodeSpec('recorder', 'recorder', {**on_machine, 'folder': str(folder)}))
    return nodes
