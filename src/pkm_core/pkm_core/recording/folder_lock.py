"""One recorder per folder: two would use the same names for their bags."""

import fcntl
import os

from pkm_core.errors import BagError
from pkm_core.files import writable_folder


class FolderLock:
    """
    Locks `folder` (a path, created if missing) for one recorder until `release` or the end of its process.

    Raises
    ------
    PkmError
        If the folder cannot be written; a `BagError` if another recorder has locked it.

    """

    def __init__(self, folder):
        self.path = writable_folder(folder)
        self._descriptor = os.open(self.path, os.O_RDONLY)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._descriptor)
            raise BagError(
                f'{self.path}: another recorder writes its bags there; stop it or name another folder'
            ) from None

    def release(self):
        """Unlock the folder."""
        os.close(self._descriptor)
