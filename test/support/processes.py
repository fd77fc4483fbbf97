"""Real processes in a ROS domain of their own, ended by their ids."""

import os
import signal
import subprocess
from time import monotonic, sleep

import pytest


def without_reports(printed):
    """Return `printed` without the lines in which Fast DDS reports that it takes another port of shared memory."""
    return ''.join(line for line in printed.splitlines(keepends=True) if 'RTPS_TRANSPORT_SHM' not in line)


class Processes:
    """Starts programs in one ROS domain and ends them at the end of the test."""

    def __init__(self, domain, folder):
        self.environment = os.environ | {
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'COLUMNS': '120',
        }
        self.folder = folder
        self._started = []

    def run(self, *command, timeout=240):
        """Run a program to its end and return it with its output, see `without_reports`."""
        done = subprocess.run(
            [str(word) for word in command],
            env=self.environment,
            cwd=self.folder,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
        done.stderr = without_reports(done.stderr)
        return done

    def start(self, *command, log='log'):
        """Start a program; what it prints goes to the file `log` of the test's folder."""
        with (self.folder / log).open('w') as stream:
            process = subprocess.Popen(
                [str(word) for word in command],
                env=self.environment,
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self._started.append(process)
        return process

    def stop(self, process):
        """Interrupt one of them and wait until it has ended."""
        process.send_signal(signal.SIGINT)
        process.wait(timeout=15.0)

    def end(self):
        """Interrupt what still runs, then kill what does not listen."""
        for process in self._started:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        deadline = monotonic() + 15.0  # a recorder closes its bag first
        for process in self._started:
            while process.poll() is None and monotonic() < deadline:
                sleep(0.05)
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()


@pytest.fixture
def processes(request, tmp_path):
    """Return `Processes` in the ROS domain the module names as DOMAIN."""
    started = Processes(request.module.DOMAIN, tmp_path)
    yield started
    started.end()


@pytest.fixture(scope='module')
def module_processes(request, tmp_path_factory):
    """Return `Processes` for all tests of a module."""
    started = Processes(request.module.DOMAIN, tmp_path_factory.mktemp('processes'))
    yield started
    started.end()
