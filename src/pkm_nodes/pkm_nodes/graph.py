"""Who runs in a cell: the one list that the composed cell, `pkm run` and the launch file start their nodes from."""

import re
from dataclasses import dataclass, field
from pathlib import Path

from pkm_core.control.controllers import find_control
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine

# where a cell lives in the graph unless it is told otherwise
NAMESPACE = '/pkm'
# what the parameter and the options of this name say of themselves
ENVIRONMENTS = 'how rough the world is: ideal, nominal, hard, elastic (four_dof) or another section of config/truth'


@dataclass(frozen=True)
class NodeSpec:
    """One process of the cell when it is spread out: an executable of pkm_nodes, its node name and parameters."""

    executable: str
    name: str
    parameters: dict = field(default_factory=dict)

    def arguments(self, common, namespace=NAMESPACE):
        """Return the command line that starts this node in `namespace` with its and the `common` parameters."""
        parameters = {**common, **self.parameters}
        moved = [('__ns', namespace), *clock_of(namespace)]
        settings = [word for key, value in parameters.items() for word in ('-p', f'{key}:={_yaml(value)}')]
        # only where it differs: __node renames every node of a process, and the machine's has six
        rename = [] if self.name == self.executable else ['-r', f'__node:={self.name}']
        return ['--ros-args', *rename, *(word for rule in moved for word in ('-r', ':='.join(rule))), *settings]


def namespace_of(text):
    """Return the namespace that `text` names, with or without a slash in front; `PkmError` if none can be called so."""
    if not re.fullmatch(r'/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*', text, re.ASCII):
        raise PkmError(f'namespace {text!r} given; expected letters, digits and _, not a digit first, / between names')
    return '/' + text.removeprefix('/')


def whole_number(name, text):
    """Return the whole number from 0 that `text`, given as `name`, is; `PkmError` if it is none."""
    if not re.fullmatch(r'\d+', text, re.ASCII):
        raise PkmError(f'{name} {text!r} given; expected a whole number from 0')
    return int(text)


def clock_of(namespace):
    """Return the remappings that give a cell in `namespace` a time of its own; the one in /pkm has /clock."""
    return [] if namespace == NAMESPACE else [('/clock', f'{namespace}/clock')]


def _yaml(value):
    return str(value).lower() if isinstance(value, bool) else str(value)


def controller_nodes(machine, control):
    """Return the `NodeSpec`s of what answers the encoders of `machine` (name or file) under a choice of `control`."""
    parameters, model = {'machine': str(machine), 'control': str(control)}, load_machine(machine)
    if find_control(model, control)[0] == 'computed_torque':
        return [NodeSpec('computed_torque_controller', 'computed_torque_controller', parameters)]
    return [
        NodeSpec('joint_controller', f'joint_controller_{joint}', {**parameters, 'joint': joint})
        for joint in model.joints
    ]


def cell_nodes(machine, *, control='robust', seed=1, environment='nominal', folder='', record=True):
    """
    Return the `NodeSpec`s of a whole cell around `machine` (name or file).

    `control` chooses the controllers, see `find_control`; `seed` and `environment` go to the simulated machine,
    `folder` takes the recorder's bags, and a folder `identified` beside it models and pictures; without `record` there
    is no recorder and the machine does not wait for one.
    """
    on_machine = {'machine': str(machine)}
    on_control = {**on_machine, 'control': str(control)}
    nodes = [
        NodeSpec(
            'machine',
            'machine',
            {**on_machine, 'seed': seed, 'environment': environment, 'wait_for_recorder': record},
        ),
        NodeSpec('trajectory_generator', 'trajectory_generator', on_control),
        NodeSpec('inverse_kinematics', 'inverse_kinematics', on_machine),
        *controller_nodes(machine, control),
        NodeSpec('state_estimator', 'state_estimator', on_machine),
        NodeSpec('learning', 'learning', on_control),
        NodeSpec('identification', 'identification', {**on_control, 'folder': str(Path(folder).parent / 'identified')}),
    ]
    if record:
        nodes.append(NodeSpec('recorder', 'recorder', {**on_control, 'folder': str(folder)}))
    return nodes
