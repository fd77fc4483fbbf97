"""Attacks on what surrounds a cell: disk, folder, shared memory, open files, another user."""

import os
import resource
import shutil
import subprocess
from contextlib import contextmanager
from pathlib import Path

from campaign.attacks import FellShortError, NotPossibleError, attack
from campaign.world import BIN, RUN

# size of /dev/shm, arrangement
SHARED_MEMORY = [(size, each) for size in ('64k', '1m', '16m', 'full') for each in ('composed', 'processes')]
# name of a limit, value [files, B, B]
LIMITS = [('NOFILE', n) for n in (32, 64, 128, 256)] + [('FSIZE', 50_000), ('AS', 300 << 20), ('AS', 1 << 30)]


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


@attack(
    'surroundings', share=2, cases=[(s, a) for s in ('64k', '1m', '16m', 'full') for a in ('composed', 'processes')]
)
def little_shared_memory(world, draw, case):
    """/dev/shm of a few sizes, as in a container, and one in which another program has left 4 KiB."""
    size, arrangement = case
    limit, fill = ('32m', 'head -c 32764k /dev/zero > /dev/shm/other && ') if size == 'full' else (size, '')
    script = f'mount -t tmpfs -o size="$0" tmpfs /dev/shm && {fill}exec "$@"'
    inside = ['unshare', '-m', 'bash', '-c', script, limit]
    if subprocess.run([*inside, 'true'], capture_output=True, check=False).returncode:
        raise NotPossibleError('unshare -m: not permitted')
    out = world.folder / 'run'
    client = world.start(*inside, BIN / 'pkm', 'run', '--cycles', 2, '--arrangement', arrangement, '--out', out)
    return _ended_well(world, client, f'/dev/shm of {size}, {arrangement}', out)


@attack('surroundings', share=2, cases=LIMITS)
def low_limit(world, draw, case):
    """A low limit of the shell: open files, size of a file, address space."""
    name, limit = case
    out, kind = world.folder / 'run', getattr(resource, f'RLIMIT_{name}')

    def lower():
        resource.setrlimit(kind, (limit, limit))

    client = world.pkm('run', '--cycles', 2, '--out', out, before=lower)
    return _ended_well(world, client, f'{name} {limit}', None if name == 'FSIZE' else out)


@attack('surroundings')
def two_clients(world, draw):
    """Two clients that start a cell in one namespace: at most one runs; the other names it."""
    verbs = [draw.choice(['run --cycles 30', 'identify-cell --machine planar']) for _ in 'ab']
    clients = [world.pkm(*verb.split(), '--out', world.folder / n, log=n) for n, verb in zip('ab', verbs, strict=True)]
    codes = [world.code_of(client, RUN, f'pkm {verb}') for client, verb in zip(clients, verbs, strict=True)]
    what = f'pkm {verbs[0]} beside pkm {verbs[1]}: exit codes {codes}'
    for name, code in zip('ab', codes, strict=True):
        if code and 'session' not in world.text(name) and 'machines run' not in world.text(name):
            raise FellShortError(f'{what}: the refusal does not name the other cell: {world.tail(name)}')
    if codes == [0, 0]:
        raise FellShortError(f'{what}: both ran')
    world.require_nothing_left()
    world.require_no_traceback()
    for name in 'ab':
        world.require_whole_bags(world.folder / name)
    return what


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
    if not any(words in world.text() for words in ('session', '2 machines run', 'of another user of this computer')):
        raise FellShortError(f'another user{may_read}: the refusal does not name the first cell: {world.tail()}')
    world.end_all()
    world.require_no_traceback()
    return f'another user{may_read}, exit code {code}: {world.tail()}'
