"""
`ros2 launch pkm_nodes cell.launch.py machine:=four_dof arrangement:=processes namespace:=pkm`.

The nodes are those of pkm_nodes.graph.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from pkm_core.servo.pace import PACE, TIME, TIMES
from pkm_nodes.graph import (
    ENVIRONMENTS,
    LEARNING_TARGET,
    TARGETS,
    WITHOUT,
    cell_nodes,
    clock_of,
    composed_cell,
    names_in,
    namespace_of,
    pace_of,
    whole_number,
)
from pkm_nodes.runtime.node import CONTROL, MACHINE
from pkm_nodes.runtime.session import new_session

ARGUMENTS = [
    DeclareLaunchArgument('machine', default_value='four_dof', description=MACHINE),
    DeclareLaunchArgument('control', default_value='robust', description=CONTROL),
    DeclareLaunchArgument(
        'arrangement',
        default_value='composed',
        choices=['composed', 'processes'],
        description='one process, or one process per node',
    ),
    DeclareLaunchArgument('namespace', default_value='pkm', description='ROS namespace of the cell'),
    DeclareLaunchArgument('seed', default_value='1', description='seed of the random numbers of the machine'),
    DeclareLaunchArgument('environment', default_value='nominal', description=ENVIRONMENTS),
    DeclareLaunchArgument('folder', default_value='bags', description='folder for the bags, one per cycle'),
    DeclareLaunchArgument(
        'learning_target', default_value='joints', choices=list(TARGETS), description=LEARNING_TARGET
    ),
    DeclareLaunchArgument('pace', default_value='0', description=PACE),
    DeclareLaunchArgument('time', default_value='standing', choices=list(TIMES), description=TIME),
    DeclareLaunchArgument('without', default_value='', description=WITHOUT),
]


def _nodes(context):
    value = {argument.name: LaunchConfiguration(argument.name).perform(context) for argument in ARGUMENTS}
    settings = {
        'machine': value['machine'],
        'control': value['control'],
        'seed': whole_number('seed', value['seed']),
        'environment': value['environment'],
        'folder': value['folder'],
        'learning_target': value['learning_target'],
        'pace': pace_of(value['pace']),
        'time': value['time'],
        'without': names_in(value['without']),
    }
    namespace = namespace_of(value['namespace'])
    composed = value['arrangement'] == 'composed'
    common = {'use_sim_time': True, 'session': new_session()}
    specs = [composed_cell(**settings)] if composed else cell_nodes(**settings)
    return [
        Node(
            package='pkm_nodes',
            executable=spec.executable,
            # the machine's process has six nodes; a name given here would rename them all
            name=None if spec.name == spec.executable else spec.name,
            namespace=namespace,
            remappings=clock_of(namespace),
            parameters=[{**common, **spec.parameters}],
            output='screen',
        )
        for spec in specs
    ]


def generate_launch_description():
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=_nodes)])
