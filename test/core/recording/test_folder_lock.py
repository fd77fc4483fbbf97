"""One recorder per folder."""

import os

import pytest

from pkm_core.errors import BagError, PkmError
from pkm_core.recording.folder_lock import FolderLock


def test_second_recorder_is_refused_until_release(tmp_path):
    first = FolderLock(tmp_path / 'bags')
    with pytest.raises(
        BagError,
        match=rf'bags: another recorder writes its bags there \(process {os.getpid()} of user \w+\); stop it or',
    ):
        FolderLock(tmp_path / 'bags')
    FolderLock(tmp_path / 'others').release()
    first.release()
    FolderLock(tmp_path / 'bags').release()


def test_folder_without_write_access_is_refused():
    with pytest.raises(PkmError, match='/proc/nowhere: cannot be written'):
        FolderLock('/proc/nowhere')


def test_new_folder_is_of_its_user_only(tmp_path):
    """Another user cannot lock it; a folder that exists keeps its mode."""
    FolderLock(tmp_path / 'runs' / 'bags').release()
    assert (tmp_path / 'runs' / 'bags').stat().st_mode & 0o777 == 0o700
    (tmp_path / 'open').mkdir(mode=0o755)
    FolderLock(tmp_path / 'open').release()
    assert (tmp_path / 'open').stat().st_mode & 0o777 == 0o755
