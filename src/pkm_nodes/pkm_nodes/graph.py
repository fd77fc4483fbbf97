"""The nodes of a cell: the one list from which the composed cell, `pkm run` and the launch file start them."""

import re
from dataclasses import dataclass, field
from pathlib import Path

from pkm_core.errors import ConfigError, PkmError
from pkm_core.machines import load_machine
from pkm_core.servo.pace import ALLOWED, checked_pace

# texts that YAML 1.1 reads as a truth value, a number or nothing
_LIKE_NO_TEXT = re.compile(r'(?i:y|yes|n|no|on|off|true|false|null|~|[-+.]?\d[\d_.:xobe+-]*)', re.ASCII)
# default namespace of a cell
NAMESPACE = '/pkm'
# descriptions of parameters that several nodes and the launch file have
ENVIRONMENTS = (
    'level of imperfections: ideal, nominal, hard, geometric, warm, flexible, elastic, a section of config/truth'
)
WITHOUT = 'comma-separated names of nodes that are not started, because other nodes replace them'
LEARNING_TARGET = 'joints: the controllers learn from the encoders; tool: the reference is also learned from the laser'
TARGETS = ('joints', 'tool')


def learning_target(node):
    """Declare the parameter `learning_target` of `node` and return its value; `ConfigError` unless it is known."""
    return checked_target(node.setting('learning_target', 'joints', LEARNING_TARGET))


def checked_target(text):
    """Return the learning target `text`; `ConfigError` unless it is one of `TARGETS`."""
    if text not in TARGETS:
        raise ConfigError(f'learning_target: {text!r} given; allowed: {", ".join(TARGETS)}')
    return text


@dataclass(frozen=True)
class NodeSpec:
    """One process of a cell in processes: an executable of pkm_nodes, its node name and its parameters."""

    executable: str
    name: str
    parameters: dict = field(default_factory=dict)
    offers: tuple[str, ...] = ()  # topics and services that a motion needs

    def arguments(self, common, namespace=NAMESPACE):
        """Return the ROS arguments of this node in `namespace`, with its own and the `common` parameters."""
        parameters = {**common, **self.parameters}
        moved = [('__ns', namespace), *clock_of(namespace)]
        settings = [word for key, value in parameters.items() for word in ('-p', f'{key}:={_yaml(value)}')]
        # only if the name differs: __node renames every node of a process, and the machine's process has six
        rename = [] if self.name == self.executable else ['-r', f'__node:={self.name}']
        return ['--ros-args', *rename, *(word for rule in moved for word in ('-r', ':='.join(rule))), *settings]


def namespace_of(text):
    """Return the namespace `text` with a leading slash; `PkmError` if it is not a valid name."""
    if not re.fullmatch(r'/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*', text, re.ASCII):
        raise PkmError(
            f'namespace: {text!r} given; expected names of letters, digits and _, not a digit first, joined by /'
        )
    return '/' + text.removeprefix('/')


def whole_number(name, text):
    """Return `text`, the value of the argument `name`, as an integer; `PkmError` unless it is 0 or more."""
    if not re.fullmatch(r'\d+', text, re.ASCII):
        raise PkmError(f'{name}: {text!r} given; expected an integer, 0 or more')
    return int(text)


def pace_of(text):
    """Return the pace `text` as a number; `PkmError` unless it is 0 or in the range of `checked_pace`."""
    try:
        return checked_pace(float(text), 'pace')
    except ValueError:
        raise PkmError(f'pace: {text!r} given; {ALLOWED}') from None


def clock_of(namespace):
    """Return the remappings that give a cell in `namespace` its own clock topic; a cell in /pkm has /clock."""
    return [] if namespace == NAMESPACE else [('/clock', f'{namespace}/clock')]


def frame_prefix_of(namespace):
    """Return what the frames of a cell in `namespace` begin with: '' in /pkm, 'left/' in /left, as for the clock."""
    return '' if namespace == NAMESPACE else f'{namespace.strip("/")}/'


def _yaml(value):
    """Return `value` for a ROS command line; a text that YAML would read as something else (y, 1e3) is quoted."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"'{value}'" if isinstance(value, str) and _LIKE_NO_TEXT.fullmatch(value) else str(value)


def controller_nodes(machine_name, control):
    """Return the `NodeSpec`s of the controllers of a machine (name or file) for a choice of `control`."""
    from pkm_core.control.controllers import find_control  # numba takes a second

    parameters, machine = {'machine': str(machine_name), 'control': str(control)}, load_machine(machine_name)
    if find_control(machine, control)[0] == 'computed_torque':
        commands = tuple(f'{joint}/command' for joint in machine.joints)
        return [NodeSpec('computed_torque_controller', 'computed_torque_controller', parameters, commands)]
    return [
        NodeSpec('joint_controller', f'joint_controller_{joint}', {**parameters, 'joint': joint}, (f'{joint}/command',))
        for joint in machine.joints
    ]


def names_in(text):
    """Return the names in the comma-separated `text`."""
    return [name.strip() for name in text.split(',') if name.strip()]


def leave_out(nodes, names):
    """Return `nodes` without those named in `names`; `PkmError` if a name is unknown."""
    known = [spec.name for spec in nodes]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise PkmError(
            f'without: no node of this cell is called {unknown}; known: {known}; '
            'linear motors and laser run in the process of machine'
        )
    return [spec for spec in nodes if spec.name not in names]


def cell_nodes(
    machine,
    *,
    control='robust',
    seed=1,
    environment='nominal',
    folder='',
    record=True,
    without=(),
    plugins='',
    learned='',
    learning_target='joints',
    pace=0.0,
    time='standing',
):
    """
    Return the `NodeSpec`s of all processes of a cell.

    Parameters
    ----------
    machine : str or Path
        Name of a machine, or a YAML file.
    control : str
        Choice of the controllers, see `find_control`.
    seed, environment : int, str
        Of the simulated machine.
    folder : str or Path
        Gets the recorder's bags; models and calibrated machines go into `identified` and `calibrated` beside it.
    record : bool
        Whether there is a recorder; without one the machine does not wait for it.
    without : iterable of str
        Names of nodes to leave out.
    plugins : str
        Comma-separated folders whose Python files may be learning laws.
    learned : str or Path
        Folder in which learned feedforward may be saved, by default `learned` beside `folder`.
    learning_target : str
        'joints' or 'tool'; the latter adds the node tool_learning.
    pace : float
        Simulated time per wall time, 0: as fast as possible.
    time : str
        'standing' or 'continuous': simulated time between cycles.

    Raises
    ------
    ConfigError
        If the machine is calibrated and of another specimen than the simulated machine of the cell.

    """
    loaded = load_machine(machine)
    joints = loaded.joints
    if 'machine' not in without:
        loaded.check_specimen(seed, environment)
    on_machine = {'machine': str(machine)}
    on_control = {**on_machine, 'control': str(control)}
    with_laws = {**on_control, **({'plugins': plugins} if plugins else {})}  # ROS refuses an empty value
    calibrated = str(Path(folder).parent / 'calibrated')
    learned = str(learned or Path(folder).parent / 'learned')
    at_tool = checked_target(learning_target) == 'tool'
    target = {'learning_target': 'tool'} if at_tool else {}
    of_machine = {'seed': seed, 'environment': environment, 'pace': float(pace), 'time': time}
    nodes = [
        NodeSpec(
            'machine',
            'machine',
            {**on_machine, **of_machine, 'wait_for_recorder': record},
            tuple(f'{joint}/encoder' for joint in joints),
        ),
        NodeSpec(
            'trajectory_generator',
            'trajectory_generator',
            {**with_laws, 'calibrated': calibrated},
            ('pose_trajectory',),
        ),
        NodeSpec('inverse_kinematics', 'inverse_kinematics', on_machine | target, ('joint_trajectory',)),
        *controller_nodes(machine, control),
        NodeSpec('state_estimator', 'state_estimator', on_machine, ('pose', 'joint_states')),
        NodeSpec('learning', 'learning', {**with_laws, 'folder': learned}, ('learning/update',)),
        NodeSpec('identification', 'identification', {**on_control, 'folder': str(Path(folder).parent / 'identified')}),
        NodeSpec('calibration', 'calibration', {**on_machine, 'folder': calibrated}),
    ]
    if at_tool:
        nodes.append(NodeSpec('tool_learning', 'tool_learning', with_laws, ('joint_correction',)))
    if record:
        nodes.append(NodeSpec('recorder', 'recorder', {**on_control, 'folder': str(folder)}, ('recorder/tick',)))
    return leave_out(nodes, without)


def composed_cell(machine, *, without=(), **options):
    """Return the `NodeSpec` of the same cell in one process."""
    left_out = {'without': ','.join(without)} if without else {}  # ROS refuses an empty value on a command line
    given = {name: value for name, value in options.items() if value != ''}
    return NodeSpec('cell', 'cell', {'machine': str(machine), **given, **left_out})
