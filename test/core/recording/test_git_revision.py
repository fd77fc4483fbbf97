"""The commit of the source tree in bags: it is read without a trace in the repository."""

import re
import resource
import subprocess
from pathlib import Path

import pytest

from pkm_core.recording import provenance

git_revision = provenance.git_revision.__wrapped__  # without its cache


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """Make a repository with more files than a small disk has room for in its index; the source is said to be in it."""
    for number in range(400):
        (tmp_path / f'file_{number}').write_text('content')
    named = ['-c', 'user.name=test', '-c', 'user.email=test@localhost']
    for words in (['init', '-q'], ['add', '-A'], [*named, 'commit', '-qm', 'all']):
        subprocess.run(['git', *words], cwd=tmp_path, check=True)
    monkeypatch.setattr(provenance, '__file__', str(tmp_path / 'module.py'))
    return tmp_path


def test_edited_tree_is_marked(repository):
    clean = git_revision()
    assert re.fullmatch('[0-9a-f]{12}', clean)
    (repository / 'new').touch()
    assert git_revision() == clean, 'a new file is no edit'
    (repository / 'file_7').write_text('other')
    assert git_revision() == f'{clean}-dirty'


def test_full_disk_leaves_no_lock_in_the_repository(repository):
    """Git would write a new index, because the times of the files have changed."""
    for path in repository.glob('file_*'):
        path.touch()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        found = git_revision()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert re.fullmatch('[0-9a-f]{12}', found)
    assert not Path(repository / '.git' / 'index.lock').exists()


def test_source_without_repository_has_no_revision(tmp_path, monkeypatch):
    monkeypatch.setattr(provenance, '__file__', str(tmp_path / 'module.py'))
    assert git_revision() == 'unknown'
