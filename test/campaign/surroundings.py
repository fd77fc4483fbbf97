"""Attacks on what surrounds a cell: disk, folder, shared memory, open files, another user, many cycles."""

import os
import resource
import shutil
import subprocess
from contextlib import contextmanager, suppress
from pathlib import Path
from time import sleep

from campaign.attacks import FellShortError, NotPossibleError, attack
from campaign.world import BIN, RUN

_SOAK = 2000
_GROWTH = 30.0  # [MB] allowed between cycle 50 and the last


@contextmanager
def _small_disk(folder, size):
    """Mount a disk of `size` bytes at `folder`; needs root."""
    folder.mkdir()
    done = subprocess.run(
        ['mount', '-t', 'tmpfs', '-o', f'size={size}', 'tmpfs', folder], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise NotPossibleError(f'mount: {done.stderr.strip()}')
    try:
        yield
    finally:
        subprocess.run(['umount', '-l', folder], check=False)


def _ended_well(world, client, what, out=None):
    """Check a run that may fail: it ends, says why in its last line, leaves nothing running and whole bags."""
    code = world.code_of(client, RUN, what)
    if code and not world.text().strip():
        raise FellShortError(f'{what}: exit code {code} without a word')
    world.require_nothing_left()
    world.require_no_traceback()
    if out:
        world.require_whole_bags(out)
    return f'{what}, exit code {code}: {world.tail() if code else "held"}'


@attack('surroundings')
def full_disk(world, draw):
    size = draw.randrange(100_000, 3_000_000)
    with _small_disk(world.folder / 'disk', size):
        out = world.folder / 'disk' / 'run'
        client = world.pkm('run', '--cycles', 12, '--out', out)
        code = world.code_of(client, RUN, f'a disk of {size} bytes')
        world.require_nothing_left()
        world.require_no_traceback()
        if code == 0 and not (out / 'results.json').exists():
            raise FellShortError(f'a disk of {size} bytes: exit code 0 without results')
    return f'a disk of {size} bytes, exit code {code}: {world.tail() if code else "held"}'


@attack('surroundings')
def folder_deleted(world, draw):
    out = world.folder / 'run'
    client = world.pkm('run', '--cycles', 12, '--out', out)
    world.wait_for(lambda: any(out.glob('bags/*')) or client.poll() is not None, RUN, 'the first cycle')
    shutil.rmtree(out, ignore_errors=True)
    return _ended_well(world, client, 'its folder deleted during a run')


@attack('surroundings')
def folder_not_writable(world, draw):
    out = world.folder / 'run'
    out.mkdir()
    done = subprocess.run(
        ['mount', '-t', 'tmpfs', '-o', 'ro', 'tmpfs', out], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise NotPossibleError(f'mount: {done.stderr.strip()}')
    try:
        return _ended_well(world, world.pkm('run', '--cycles', 1, '--out', out), 'a folder that is read-only')
    finally:
        subprocess.run(['umount', '-l', out], check=False)


@attack('surroundings')
def little_shared_memory(world, draw):
    """/dev/shm of a few sizes, as in a container."""
    size = draw.choice(['64k', '1m', '16m'])
    script = 'mount -t tmpfs -o size="$0" tmpfs /dev/shm && exec "$@"'
    inside = ['unshare', '-m', 'bash', '-c', script, size]
    if subprocess.run([*inside, 'true'], capture_output=True, check=False).returncode:
        raise NotPossibleError('unshare -m: not permitted')
    out = world.folder / 'run'
    arrangement = draw.choice(['composed', 'processes'])
    client = world.start(*inside, BIN / 'pkm', 'run', '--cycles', 2, '--arrangement', arrangement, '--out', out)
    return _ended_well(world, client, f'/dev/shm of {size}, {arrangement}', out)


@attack('surroundings')
def few_open_files(world, draw):
    limit, out = draw.choice([32, 64, 128, 256]), world.folder / 'run'

    def lower():
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))

    client = world.pkm('run', '--cycles', 2, '--out', out, before=lower)
    return _ended_well(world, client, f'{limit} open files', out)


@attack('surroundings')
def other_user(world, draw):
    """The lock and the bags of a cell are those of its user; another user of the computer gets one line."""
    if os.getuid() != 0:
        raise NotPossibleError('needs root')
    out = world.folder / 'run'
    first = world.pkm('run', '--cycles', 200, '--out', out, log='first')
    world.wait_for(lambda: any(out.glob('bags/*')) or first.poll() is not None, RUN, 'the first cycle')
    theirs = Path('/tmp') / world.mark
    theirs.mkdir()
    theirs.chmod(0o777)
    as_other = ['setpriv', '--reuid=65534', '--regid=65534', '--clear-groups']
    python = ['env', BIN / 'python', '-c', '']  # env: setpriv itself still has the capabilities of root
    may_read = ''
    if subprocess.run([*as_other, *python], capture_output=True, check=False).returncode:
        # the Python of this checkout is in a folder of root
        as_other += ['--inh-caps=+dac_read_search', '--ambient-caps=+dac_read_search']
        may_read = ' that may read all files'
    if subprocess.run([*as_other, *python], capture_output=True, check=False).returncode:
        raise NotPossibleError('another user may not execute the Python of this checkout')
    try:
        second = world.start(*as_other, BIN / 'pkm', 'run', '--cycles', 1, '--out', theirs / 'run', HOME=str(theirs))
        code = world.code_of(second, RUN, 'pkm run of another user beside a running cell')
    finally:
        shutil.rmtree(theirs, ignore_errors=True)
    if first.poll() is not None:
        raise FellShortError(f'the first run has ended: {world.tail("first")}')
    if code == 0:
        raise FellShortError('pkm run of another user ran beside a cell in the same namespace')
    if 'session' not in world.text() and '2 machines run' not in world.text():
        raise FellShortError(f'another user{may_read}: the refusal does not name the first cell: {world.tail()}')
    world.end_all()
    world.require_no_traceback()
    return f'another user{may_read}, exit code {code}: {world.tail()}'


@attack('surroundings')
def soak(world, draw):
    """Two thousand cycles in one goal: memory and figures are steady."""
    out = world.folder / 'run'
    client = world.pkm('run', '--cycles', _SOAK, '--out', out)
    world.wait_for(lambda: len(list(out.glob('bags/*'))) >= 50 or client.poll() is not None, RUN, '50 cycles')
    before = largest = _memory(world)
    while client.poll() is None:
        largest = max(largest, _memory(world))
        sleep(1.0)
    if client.returncode:
        raise FellShortError(f'{_SOAK} cycles: {world.tail()}')
    figures = world.figures(out)
    if len(figures) != _SOAK:
        raise FellShortError(f'{len(figures)} of {_SOAK} cycles in results.json')
    if largest > before + _GROWTH:
        raise FellShortError(f'{_SOAK} cycles: the cell grew from {before:.0f} to {largest:.0f} MB')
    world.require_no_traceback()
    return f'{_SOAK} cycles; memory of the cell {before:.0f} to {largest:.0f} MB'


def _memory(world):
    """Return the resident memory [MB] of the process of the composed cell; 0 once it has ended."""
    for pid, command in world.running().items():
        if 'pkm_nodes/cell' in command:
            with suppress(OSError):
                return int((Path('/proc') / str(pid) / 'statm').read_text().split()[1]) * resource.getpagesize() / 1e6
    return 0.0
