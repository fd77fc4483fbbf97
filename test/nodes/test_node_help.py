"""`--help` of every executable: purpose, parameters with defaults and topics, as the node itself has them."""

import importlib
import re
from functools import partial

import pytest

from pkm_nodes import executables
from pkm_nodes.parts import node_help

NAMES = sorted(name for name, each in vars(executables).items() if isinstance(each, partial))


@pytest.fixture
def helped(monkeypatch, capsys):
    """Return a function that returns the help of an executable."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')  # restored after the test

    def show(name):
        node_help.show(name)
        return capsys.readouterr().out

    return show


@pytest.mark.parametrize('name', NAMES)
def test_help_has_purpose_parameters_and_topics(helped, name):
    text = helped(name)
    assert importlib.import_module(f'pkm_nodes.nodes.{name}').__doc__.strip().splitlines()[0] in text
    assert f'usage: ros2 run pkm_nodes {name} ' in text
    assert '\n  session' in text
    assert text.count('\n\n') > 2
    assert '/help' not in text


def test_help_prints_defaults_types_and_message_types(helped):
    text = helped('joint_controller')
    assert re.search(r'\n  joint +string +d1 +', text)
    assert '\n  /pkm/d1/command [pkm_interfaces/msg/MotorCommand]\n' in text


def test_help_is_asked_for_before_the_arguments_of_ros():
    assert executables.asks_for_help(['--help'])
    assert executables.asks_for_help(['-h', '--ros-args'])
    assert not executables.asks_for_help(['--ros-args', '-p', 'name:=-h', '-h'])
    assert not executables.asks_for_help([])
