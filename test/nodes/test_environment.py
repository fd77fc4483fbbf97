"""Environment of ROS: refused in one line before rclpy reads it; leftovers of killed processes."""

import fcntl
import os
from time import time

import pytest

from pkm_core.errors import PkmError
from pkm_nodes.clients.shared_memory import remove_leftovers
from pkm_nodes.runtime import environment
from pkm_nodes.runtime.environment import check_ros_environment


@pytest.mark.parametrize('domain', ['abc', '-1', '233', '1.5', '７'])
def test_invalid_domain_is_refused(monkeypatch, domain):
    monkeypatch.setenv('ROS_DOMAIN_ID', domain)
    with pytest.raises(PkmError, match=rf"^ROS_DOMAIN_ID: '{domain}' given; expected an integer, 0 to 232$"):
        check_ros_environment()


def test_middleware_that_is_not_installed_is_refused(monkeypatch):
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_other_cpp')
    with pytest.raises(PkmError, match=r"^RMW_IMPLEMENTATION: 'rmw_other_cpp' is not installed; installed: \['rmw_f"):
        check_ros_environment()


def test_usual_environment_is_accepted(monkeypatch):
    monkeypatch.delenv('RMW_IMPLEMENTATION', raising=False)
    for domain in ('', '0', '232'):
        monkeypatch.setenv('ROS_DOMAIN_ID', domain)
        check_ros_environment()


def test_full_shared_memory_is_refused(monkeypatch):
    """/proc is a file system without free space."""
    monkeypatch.setattr(environment, '_SHARED_MEMORY', '/proc')
    with pytest.raises(PkmError, match='/proc: 0 KiB free; expected at least 16 KiB'):
        check_ros_environment()


def test_files_of_dead_processes_are_removed_and_no_others(tmp_path):
    dead, alive = 'fastrtps_0123456789abcdef', 'fastrtps_00000000000000aa'
    port, young = 'fastrtps_port7411', 'fastrtps_port7000'
    names = [name + ending for name in (dead, alive, port, young) for ending in ('', '_el')]
    for name in (*names, f'sem.{port}_mutex', 'fastrtps_notes', 'sem.other'):
        (tmp_path / name).touch()
        if young not in name:
            os.utime(tmp_path / name, (time() - 60.0,) * 2)
    with (tmp_path / f'{alive}_el').open('w') as held:
        os.utime(tmp_path / f'{alive}_el', (0.0, 0.0))
        fcntl.flock(held, fcntl.LOCK_EX)
        assert remove_leftovers(tmp_path) == 4
    left = {alive, f'{alive}_el', young, f'{young}_el', f'sem.{port}_mutex', 'fastrtps_notes', 'sem.other'}
    assert {path.name for path in tmp_path.iterdir()} == left
