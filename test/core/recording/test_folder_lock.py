"""One recorder per folder."""

import pytest

from pkm_core.errors import BagError, PkmError
from pkm_core.recording.folder_lock import FolderLock


def test_second_recorder_is_refused_until_release(tmp_path):
    first = FolderLock(tmp_path / 'bags')
    with pytest.raises(BagError, match=r'bags: another recorder writes its bags there; stop it or name another folder'):
        FolderLock(tmp_path / 'bags')
    FolderLock(tmp_path / 'others').release()
    first.release()
    FolderLock(tmp_path / 'bags').release()


def test_folder_without_write_access_is_refused():
    with pytest.raises(PkmError, match='/proc/nowhere: cannot be written'):
        FolderLock('/proc/nowhere')
