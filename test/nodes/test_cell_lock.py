"""The mark of a cell in its namespace: one per namespace, domain and user; it ends with its holder."""

import os

import pytest

from pkm_core.errors import PkmError
from pkm_nodes.parts.cell_lock import CellLock, require_free


@pytest.fixture(autouse=True)
def runtime(tmp_path, monkeypatch):
    """Put the locks of the test into a folder of its own."""
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(tmp_path))
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    return tmp_path


def test_namespace_is_held_until_release():
    lock = CellLock('/pkm', '/pkm/machine', 's1')
    with pytest.raises(
        PkmError, match=rf'node /pkm/machine, host .*, pid {os.getpid()}, domain 7, session s1; stop it'
    ):
        require_free('/pkm')
    lock.release()
    require_free('/pkm')


def test_other_namespaces_and_domains_are_free(monkeypatch):
    lock = CellLock('/pkm', '/pkm/machine', 's1')
    require_free('/left')
    monkeypatch.setenv('ROS_DOMAIN_ID', '8')
    require_free('/pkm')
    lock.release()


def test_lock_ends_with_a_killed_process():
    child = os.fork()
    if child == 0:
        CellLock('/pkm', '/pkm/machine', 's1')
        os.kill(os.getpid(), 9)
    os.waitpid(child, 0)
    require_free('/pkm')


def test_locks_are_readable_by_their_user_only(runtime):
    CellLock('/pkm', '/pkm/machine', 's1').release()
    (folder,) = runtime.iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    assert all(file.stat().st_mode & 0o777 == 0o600 for file in folder.iterdir())


def test_link_in_place_of_the_folder_is_refused(runtime):
    (runtime / f'pkm-{os.getuid()}').symlink_to('/tmp')
    with pytest.raises(PkmError, match='belongs to another user'):
        require_free('/pkm')


def test_missing_runtime_folder_is_no_obstacle(monkeypatch, tmp_path):
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(tmp_path / 'gone'))
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path))
    require_free('/pkm')
    assert (tmp_path / f'pkm-{os.getuid()}').is_dir()


@pytest.mark.skipif(os.getuid() != 0, reason='only root can give a folder to another user')
def test_folder_of_another_user_is_refused(runtime):
    folder = runtime / f'pkm-{os.getuid()}'
    folder.mkdir()
    os.chown(folder, 12345, -1)
    with pytest.raises(PkmError, match=f'belongs to another user; expected a folder of user {os.getuid()}'):
        require_free('/pkm')
