"""Files of shared memory that killed processes have left: Fast DDS removes only those of a process that ends itself."""

import fcntl
import os
import re
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from time import time

FOLDER = Path('/dev/shm')
# data of one process, or queue of one port
_FILE = re.compile(r'fastrtps_(?:[0-9a-f]{16}|port\d{1,5})', re.ASCII)
# [s, wall] a process locks its file right after it has made it
_YOUNGEST = 2.0


def remove_leftovers(folder=FOLDER):
    """
    Remove the files of Fast DDS in `folder` that belong to this user and to no living process; return their number.

    A process holds a lock on NAME_el (or NAME_sl) as long as it uses NAME. They are removed under this lock, so that a
    process that starts meanwhile takes another port: one that had locked a port without its file would make every
    later process report an error. Mutexes of ports stay, because Fast DDS uses them again.
    """
    try:
        names = {entry.name for entry in os.scandir(folder)}
    except OSError:
        return 0
    return sum(_remove(folder / name, names) for name in sorted(filter(_FILE.fullmatch, names)))


def _remove(path, names):
    locks = [path.with_name(f'{path.name}{ending}') for ending in ('_el', '_sl') if f'{path.name}{ending}' in names]
    removed = 0
    with ExitStack() as held:
        if all(map(_is_left, [path, *locks])) and all(held.enter_context(_locked(lock)) for lock in locks):
            for each in (path, *locks):
                with suppress(OSError):
                    each.unlink()
                    removed += 1
    return removed


def _is_left(path):
    """Return whether a file of this user is older than its lock can be; False if it is gone."""
    try:
        status = path.lstat()
    except OSError:
        return False
    return status.st_uid == os.getuid() and time() - status.st_mtime > _YOUNGEST


@contextmanager
def _locked(path):
    """Hold the lock of a file; False if a process has it, or the file cannot be opened."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        yield False
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        got = True
    except OSError:
        got = False
    try:
        yield got
    finally:
        os.close(descriptor)
