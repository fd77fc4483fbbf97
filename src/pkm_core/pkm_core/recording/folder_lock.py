"""One recorder a folder: two would hand out the same names and each other's cycles."""

import fcntl
import os

from pkm_core.errors import BagError
from pkm_core.files import writable_folder


class FolderLock:
    """
    Holds `folder` (a path, made if need be) for one recorder until `release`; the lock ends with its process.

    Raises
    ------
    PkmError
        If nothing can be written there; a `BagError` if another recorder holds it.

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
        """Let the next recorder have the folder."""
        os.close(self._descriptor)
