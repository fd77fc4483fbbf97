"""`ros2 launch pkm_nodes display.launch.py namespace:=pkm`: RViz with the robot model of a cell that runs."""

import tempfile
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from pkm_nodes.graph import NAMESPACE, clock_of, frame_prefix_of, namespace_of

LAYOUT = Path(__file__).parents[1] / 'layouts' / 'cell.rviz'


def _layout(namespace):
    """Return the path of the layout with the topics and frames of `namespace`."""
    prefix = frame_prefix_of(namespace)
    if not prefix:
        return LAYOUT
    text = LAYOUT.read_text(encoding='utf-8').replace(f' {NAMESPACE}/', f' {namespace}/')
    text = text.replace('TF Prefix: ""', f'TF Prefix: {prefix.rstrip("/")}')  # RViz adds the slash
    text = text.replace('Fixed Frame: base_link', f'Fixed Frame: {prefix}base_link')
    with tempfile.NamedTemporaryFile('w', suffix='.rviz', delete=False, encoding='utf-8') as file:
        file.write(text)
    return Path(file.name)


def _nodes(context):
    namespace = namespace_of(LaunchConfiguration('namespace').perform(context))
    return [
        Node(
            package='rviz2',
            executable='rviz2',
            arguments=['-d', str(_layout(namespace))],
            remappings=clock_of(namespace),
            parameters=[{'use_sim_time': True}],
            output='screen',
        )
    ]


def generate_launch_description():
    namespace = DeclareLaunchArgument('namespace', default_value='pkm', description='ROS namespace of the cell')
    return LaunchDescription([namespace, OpaqueFunction(function=_nodes)])
