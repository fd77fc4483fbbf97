"""
The executables of the nodes: each name runs the node of this name as a process.

A node is imported after the process is prepared, see `pkm_core.start`; the imports of a node take a second or more.
With `--help` the executable prints its purpose, parameters and topics.
"""

import importlib
import sys
from functools import partial

from pkm_core.errors import PkmError
from pkm_core.start import prepare
from pkm_nodes.runtime.environment import check_ros_environment


def _run(name):
    try:
        prepare()
        check_ros_environment()
    except PkmError as error:
        print(f'{name}: {error}', file=sys.stderr)
        sys.exit(1)
    if asks_for_help(sys.argv[1:]):
        importlib.import_module('pkm_nodes.parts.node_help').show(name)
        return
    importlib.import_module(f'pkm_nodes.nodes.{name}').main()


def asks_for_help(argv):
    """Return whether `argv` has -h or --help; what stands behind --ros-args is for ROS."""
    own = argv[: argv.index('--ros-args')] if '--ros-args' in argv else argv
    return '-h' in own or '--help' in own


calibration = partial(_run, 'calibration')
cell = partial(_run, 'cell')
computed_torque_controller = partial(_run, 'computed_torque_controller')
dashboard = partial(_run, 'dashboard')
identification = partial(_run, 'identification')
inverse_kinematics = partial(_run, 'inverse_kinematics')
joint_controller = partial(_run, 'joint_controller')
learning = partial(_run, 'learning')
machine = partial(_run, 'machine')
recorder = partial(_run, 'recorder')
state_estimator = partial(_run, 'state_estimator')
tool_learning = partial(_run, 'tool_learning')
trajectory_generator = partial(_run, 'trajectory_generator')
