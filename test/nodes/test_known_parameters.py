"""Refused parameters: those that neither the node nor another node of its process declares."""

import os
import subprocess
import sys
from functools import partial

import pytest

from pkm_core.config import install_prefixes
from pkm_core.errors import ConfigError
from pkm_nodes.nodes.inverse_kinematics import InverseKinematicsNode
from pkm_nodes.nodes.machine import MachineNode

SEED = ['--ros-args', '-p', 'seed:=3']  # a parameter of the machine


def test_parameter_of_another_node_is_refused_by_default(graph):
    """Nodes made before in the same Python process have no effect."""
    graph.start(MachineNode)
    with pytest.raises(ConfigError, match=r"/pkm/inverse_kinematics has unknown parameter\(s\) \['seed'\]"):
        graph.start(partial(InverseKinematicsNode, cli_args=SEED))
    node = graph.start(partial(InverseKinematicsNode, cli_args=SEED, known_elsewhere={'seed', 'control'}))
    assert not node.has_parameter('seed')


def test_process_of_several_nodes_refuses_a_misspelt_parameter(domain_id):
    programs = [prefix / 'lib' / 'pkm_nodes' / 'cell' for prefix in install_prefixes()]
    program = next(path for path in programs if path.exists())
    command = [sys.executable, program, '--ros-args', '-p', 'sede:=3']
    environment = os.environ | {'ROS_DOMAIN_ID': str(domain_id), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120.0, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("/pkm/cell has unknown parameter(s) ['sede'] (-p sede:=3); known: [")
    assert "'seed'" in done.stderr
