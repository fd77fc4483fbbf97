"""The fast path of the servo tick, and the fallback to rclpy's public API."""

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from pkm_core.errors import ConfigError
from pkm_interfaces.msg import MotorCommand
from pkm_nodes.messages.tick_messages import MOTOR_COMMAND
from pkm_nodes.runtime import queues
from pkm_nodes.runtime.fast_path import MADE_FOR, SWITCH, FastPath
from pkm_nodes.runtime.lockstep import LockstepExecutor
from pkm_nodes.runtime.node import TICK_QOS

PUBLIC = "; using rclpy's public executor (slower)"


@pytest.fixture
def decide(graph, capfd):
    """Return a function that returns the executor a `FastPath` selects and the lines it logs."""

    def decide(fast_path):
        context = rclpy.get_default_context()
        executors = [fast_path.executor(context) for _ in range(2)]
        for executor in executors:
            executor.shutdown()
        return type(executors[0]), [line for line in capfd.readouterr().err.splitlines() if 'servo tick' in line]

    return decide


def test_installed_versions_use_the_fast_path(decide):
    assert decide(FastPath()) == (LockstepExecutor, [])


@pytest.mark.parametrize('package', MADE_FOR)
def test_other_versions_fall_back_with_one_line(decide, package):
    executor, lines = decide(FastPath(MADE_FOR | {package: '6.3'}))
    assert executor is SingleThreadedExecutor
    assert len(lines) == 1
    assert f'{package} 6.3' in lines[0].split('expected')[1]
    assert f'found rclpy {MADE_FOR["rclpy"]}.' in lines[0]
    assert lines[0].endswith(PUBLIC)


def test_package_without_version_falls_back(decide):
    executor, lines = decide(FastPath({'no_such_package': '1.0'}))
    assert executor is SingleThreadedExecutor
    assert 'found no_such_package unknown; expected no_such_package 1.0' in lines[0]


def test_switch_selects_the_public_api(decide, monkeypatch):
    monkeypatch.setenv(SWITCH, '1')
    executor, lines = decide(FastPath())
    assert executor is SingleThreadedExecutor
    assert len(lines) == 1
    assert f'servo tick: {SWITCH} is 1{PUBLIC}' in lines[0]


def test_switch_set_to_0_uses_the_fast_path(decide, monkeypatch):
    monkeypatch.setenv(SWITCH, '0')
    assert decide(FastPath()) == (LockstepExecutor, [])


def test_other_value_of_the_switch_is_refused(decide, monkeypatch):
    monkeypatch.setenv(SWITCH, 'yes')
    with pytest.raises(ConfigError, match="PKM_PUBLIC_RCLPY: 'yes' given; allowed: 0, 1"):
        decide(FastPath())


def test_self_test_finds_takes_that_differ(decide, monkeypatch):
    """An offset by one word is what another layout of rcutils_uint8_array_t would look like."""
    monkeypatch.setattr(queues, '_take_alike', corrupted(queues._take_alike))
    executor, lines = decide(FastPath())
    assert executor is SingleThreadedExecutor
    assert len(lines) == 1
    assert 'in the self-test of the fast path; expected' in lines[0]


def corrupted(take):
    def take_corrupted(subscription, message, info, content, senders, most):
        number, end, code = take(subscription, message, info, content, senders, most)
        content[:end] = 0
        return number, end, code

    return take_corrupted


def test_self_test_reports_an_error(decide, monkeypatch):
    def refuse(*_):
        raise AttributeError('no such function')

    monkeypatch.setattr(queues, '_take_alike', refuse)
    executor, lines = decide(FastPath())
    assert executor is SingleThreadedExecutor
    assert 'found AttributeError: no such function in the self-test of the fast path' in lines[0]


@pytest.mark.parametrize('switch', ['0', '1'])
def test_sender_publishes_the_same_message(graph, monkeypatch, switch):
    monkeypatch.setenv(SWITCH, switch)
    messages = graph.listen(MotorCommand, 'd1/command')
    publisher = graph.publisher(MotorCommand, 'd1/command', TICK_QOS)
    FastPath().sender(publisher, rclpy.get_default_context())(MOTOR_COMMAND.pack(7, 2, 0.1, -1e-6, 0.3))
    graph.spin_until(lambda: messages, 'the command')
    assert messages == [MotorCommand(tick=7, cycle=2, voltage=0.1, error=-1e-6, feedforward=0.3)]
