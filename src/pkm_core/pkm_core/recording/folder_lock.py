"""One recorder per folder: two would use the same names for their bags."""

import fcntl
import os
import pwd
from contextlib import suppress
from pathlib import Path

from pkm_core.errors import BagError
from pkm_core.files import writable_folder


class FolderLock:
    """
    Locks `folder` for one recorder until `release` or the end of its process.

    A missing folder is created with mode 0700: another user cannot lock it.

    Raises
    ------
    PkmError
        If the folder cannot be written; a `BagError` if another recorder has locked it.

    """

    def __init__(self, folder):
        with suppress(OSError):  # a refusal follows; others must not be able to lock it: 0700
            Path(folder).parent.mkdir(parents=True, exist_ok=True)
            Path(folder).mkdir(mode=0o700)
        self.path = writable_folder(folder)
        self._descriptor = os.open(self.path, os.O_RDONLY)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = _holder(self._descriptor)
            os.close(self._descriptor)
            raise BagError(
                f'{self.path}: another recorder writes its bags there{holder}; stop it or name another folder'
            ) from None

    def release(self):
        """Unlock the folder."""
        os.close(self._descriptor)


def _holder(descriptor):
    """Return which process of which user holds the lock of the open folder; '' if /proc does not show it."""
    inode = os.fstat(descriptor).st_ino
    with suppress(OSError, LookupError, ValueError):
        for line in Path('/proc/locks').read_text().splitlines():
            fields = line.split()
            if fields[1] == 'FLOCK' and int(fields[5].rpartition(':')[2]) == inode:
                owner = os.stat(f'/proc/{fields[4]}').st_uid
                return f' (process {fields[4]} of user {pwd.getpwuid(owner).pw_name})'
    return ''
