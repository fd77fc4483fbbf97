"""
Libraries that each executable imports at its start, read from the import statements at the top of the modules.

A library that is imported within a function is loaded when that function runs. EVERY and MORE are the plan.
"""

import ast
import sys
from functools import cache

import pytest

from support.rooms import modules

# ROS, units and checks of the configuration, the compiled tick, places of the numbers in a serialized message
EVERY = {'numpy', 'pydantic', 'yaml', 'numba', 'rclpy', 'rosbags'}
BAGS = {'mcap', 'zstandard', 'lz4'}
PHYSICS = {'scipy'}  # modes of the machine; splines of trajectories that are sent
MORE = {
    **dict.fromkeys(('machine', 'laser', 'trajectory_generator'), PHYSICS),
    **dict.fromkeys(('dashboard', 'recorder'), BAGS),
    'cell': BAGS | PHYSICS,
}
NODES = sorted(name for name in modules() if name.startswith('pkm_nodes.nodes.'))
# interfaces and tools of ROS, which rclpy imports in any case
OF_ROS = ('_msgs', '_interfaces', 'rcl', 'rosidl', 'rpyutils', 'ament', 'std_srvs')


@cache
def imports_at_start(module):
    """Return the modules that the statements at the top of `module` import, of the house and of others."""
    found = set()
    body = list(ast.parse(modules()[module].read_text(encoding='utf-8')).body)
    while body:
        node = body.pop()
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f'{node.module}.{alias.name}' for alias in node.names)}
        elif isinstance(node, ast.If | ast.Try | ast.With):
            body += [each for each in ast.iter_child_nodes(node) if isinstance(each, ast.stmt)]
        elif isinstance(node, ast.ClassDef):
            body += [each for each in node.body if isinstance(each, ast.stmt)]
    return found


def libraries(module):
    """Return the top-level names of the libraries that the import of `module` leads to."""
    todo, seen, found = [module], set(), set()
    while todo:
        name = todo.pop()
        if name in seen:
            continue
        seen.add(name)
        if name in modules():
            parents = name.split('.')
            todo += ['.'.join(parents[:count]) for count in range(1, len(parents))]
            todo += imports_at_start(name)
        elif not name.startswith(('pkm_core', 'pkm_nodes')):
            found.add(name.partition('.')[0])
    return {name for name in found if name not in sys.stdlib_module_names and not _is_of_ros(name)} | (
        {'rclpy'} if 'rclpy' in found else set()
    )


def _is_of_ros(name):
    return name.endswith(OF_ROS[:2]) or name.startswith(OF_ROS[2:])


@pytest.mark.parametrize('module', NODES)
def test_node_imports_no_library_it_does_not_use(module):
    """No plots, tables of pandas, web page or files of bags in a node that has nothing to do with them."""
    more = MORE.get(module.rpartition('.')[2], set())
    assert libraries(module) <= EVERY | more
    assert libraries(module) >= more, 'the plan allows what is not used'


def test_executables_import_their_node_only_when_they_run():
    assert libraries('pkm_nodes.executables') == set()


def test_run_refuses_an_option_before_it_imports_a_compiler():
    assert libraries('pkm_nodes.verbs.run') == {'numpy', 'pydantic', 'yaml', 'rich', 'typer'}
