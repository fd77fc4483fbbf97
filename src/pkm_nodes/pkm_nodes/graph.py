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
WITHOUT = 'names of nodes to leave out, with commas between them; others take their place'


@dataclass(frozen=True)
class NodeSpec:
    """One process of the cell when it is spread out: an executable of pkm_nodes, its node name and parameters."""

    executable: str
    name: str
    parameters: dict = field(default_factory=dict)
    offers: tuple[str, ...] = ()  # topics and services without which no motion runs

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
        commands = tuple(f'{joint}/command' for joint in model.joints)
        return [NodeSpec('computed_torque_controller', 'computed_torque_controller', parameters, commands)]
    return [
        NodeSpec('joint_controller', f'joint_controller_{joint}', {**parameters, 'joint': joint}, (f'{joint}/command',))
        for joint in model.joints
    ]


def names_in(text):
    """Return the names in `text`, which has commas between them."""
    return [name.strip() for name in text.split(',') if name.strip()]


def leave_out(nodes, names):
    """Return `nodes` without those of these `names`; `PkmError` if there is no such node."""
    known = [spec.name for spec in nodes]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise PkmError(
            f'without: no node of this cell is called {unknown}; known: {known}, '
            'linear motors and laser come and go with machine'
        )
    return [spec for spec in nodes if spec.name not in names]


def cell_nodes(machine, *, control='robust', seed=1, environment='nominal', folder='', record=True, without=()):
    """
    Return the `NodeSpec`s of a whole cell around `machine` (name or file).

    `control` chooses the controllers, see `find_control`; `seed` and `environment` go to the simulated machine,
    `folder` takes the recorder's bags, and a folder `identified` beside it models and pictures; without `record` there
    is no recorder and the machine does not wait for one. The nodes named in `without` are left out.
    """
    joints = load_machine(machine).joints
    on_machine = {'machine': str(machine)}
    on_control = {**on_machine, 'control': str(control)}
    nodes = [
        NodeSpec(
            'machine',
            'machine',
            {**on_machine, 'seed': seed, 'environment': environment, 'wait_for_recorder': record},
            tuple(f'{joint}/encoder' for joint in joints),
        ),
        NodeSpec('trajectory_generator', 'trajectory_generator', on_control, ('pose_trajectory',)),
        NodeSpec('inverse_kinematics', 'inverse_kinematics', on_machine, ('joint_trajectory',)),
        *controller_nodes(machine, control),
        NodeSpec('state_estimator', 'state_estimator', on_machine, ('pose', 'joint_states')),
        NodeSpec('learning', 'learning', on_control, ('learning/update',)),
        NodeSpec('identification', 'identification', {**on_control, 'folder': str(Path(folder).parent / 'identified')}),
    ]
    if record:
        nodes.append(NodeSpec('recorder', 'recorder', {**on_control, 'folder': str(folder)}, ('recorder/tick',)))
    return leave_out(nodes, without)


def composed_cell(machine, *, without=(), **options):
    """Return the `NodeSpec` of the same cell in one process."""
    left_out = {'without': ','.join(without)} if without else {}  # ROS takes no empty value on a command line
    return NodeSpec('cell', 'cell', {'machine': str(machine), **options, **left_out})
