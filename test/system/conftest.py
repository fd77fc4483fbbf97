"""Each test of this level starts real processes in its own ROS domain and ends them by their ids."""

import os
import signal
import subprocess
from pathlib import Path

import pytest

from support.processes import module_processes, processes, without_reports

TOOL = Path(__file__).resolve().parents[2] / 'bringup_scripts' / 'ros2'
__all__ = ['module_processes', 'processes', 'ros2', 'ros2_environment']


@pytest.fixture(scope='module')
def ros2_environment():
    """A separate graph on this computer, and a PATH without a real ros2."""
    return os.environ | {
        'ROS_DOMAIN_ID': '73',
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'PATH': '/usr/bin:/bin',
        'TZ': 'UTC',
        'COLUMNS': '120',
    }


@pytest.fixture
def ros2(ros2_environment):
    """Run the tool to its end, or interrupt it after it has printed the text `until`."""

    def run(*args, until='', code=0):
        process = subprocess.Popen(
            [TOOL, *map(str, args)],
            env=ros2_environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            out = ''
            while until not in out and (line := process.stdout.readline()):
                out += line
            if until:
                process.send_signal(signal.SIGINT)
            out += process.stdout.read()
            err = without_reports(process.stderr.read())
            assert process.wait() == code, out + err
        finally:
            process.kill()
            process.wait()
        assert 'Traceback' not in err
        return subprocess.CompletedProcess(args, code, out, err)

    return run
