"""Files of shared memory that killed processes have left: Fast DDS removes only those of a process that ends itself."""

import fcntl
import os
import re
from contextlib import suppress
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

    A process holds a lock on NAME_el (or NAME_sl) as long as it uses NAME. `fastdds shm clean` uses the same criterion.
    """
    removed = 0
    try:
        names = {entry.name for entry in os.scandir(folder)}
    except OSError:
        return 0
    for name in sorted(filter(_FILE.fullmatch, names)):
        locks = [folder / f'{name}{ending}' for ending in ('_el', '_sl') if f'{name}{ending}' in names]
        if all(map(_is_left, [folder / name, *locks])) and not any(map(_is_locked, locks)):
            for path in (*locks, folder / f'sem.{name}_mutex', folder / name):
                with suppress(OSError):
                    path.unlink()
                    removed += 1
    return removed


def _is_left(path):
    """Return whether a file of this user is older than its lock can be; False if it is gone."""
    try:
        status = path.lstat()
    except OSError:
        return False
    return status.st_uid == os.getuid() and time() - status.st_mtime > _YOUNGEST


def _is_locked(path):
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return True  # not known: it stays
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False
