"""Messages of a recorder that cannot write: the disk is full, or another recorder uses the folder."""

import sys
from getpass import getuser
from pathlib import Path
from time import monotonic, sleep

from pkm_core.bag.repair import repair

DOMAIN = 112
PKM = Path(sys.prefix) / 'bin' / 'pkm'
RECORDER = Path(sys.prefix) / 'lib' / 'pkm_nodes' / 'recorder'
# [bytes] what the full disk of the test has room for in one file: the trajectories and some hundred ticks
ROOM = 60_000


def with_little_room(*command):
    """Return `command` with a file size limit of `ROOM`, which acts like a full disk."""
    limit = f'resource.setrlimit(resource.RLIMIT_FSIZE, ({ROOM}, {ROOM}))'
    code = f'import os, resource, sys; {limit}; os.execv(sys.argv[1], sys.argv[1:])'
    return [sys.executable, '-c', code, *command]


def test_full_disk_ends_the_run_with_the_reason(processes):
    """The data written before is kept."""
    done = processes.run(*with_little_room(PKM, 'run', '--cycles', 50, '--law', 'none', '--out', 'run'))
    assert done.returncode == 1
    [bag] = (processes.folder / 'run' / 'bags').iterdir()
    assert f'after 1 of 50 cycles: cycle 1 is not recorded: {bag}: File too large; ' in done.stderr
    assert f'pkm bag-doctor {bag}' in done.stderr
    assert 'Traceback' not in done.stderr
    assert min(len(ticks) for ticks in repair(bag).missing.values()) == 1, 'one run of ticks at the end'


def test_second_recorder_on_the_folder_is_refused_in_one_line(processes):
    first = processes.start(RECORDER, '--ros-args', '-p', 'folder:=bags', log='first.log')
    deadline = monotonic() + 60.0
    while not (processes.folder / 'bags').exists() and monotonic() < deadline:
        sleep(0.1)
    sleep(1.0)  # the lock follows the folder
    second = processes.run(RECORDER, '--ros-args', '-p', 'folder:=bags', timeout=60)
    assert second.returncode == 1
    holder = f'process {first.pid} of user {getuser()}'
    assert second.stderr == f'bags: another recorder writes its bags there ({holder}); stop it or name another folder\n'
    assert first.poll() is None
