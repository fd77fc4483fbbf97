"""Files that results are written to: folders that are created, JSON of arrays, and refusals."""

import json
import os

import numpy as np
import pytest

from pkm_core.errors import PkmError
from pkm_core.files import do_all, writable_file, writable_folder, write_json, write_text


def test_missing_folders_are_created(tmp_path):
    folder = writable_folder(tmp_path / 'a' / 'b')
    assert folder.is_dir()
    assert not list(folder.iterdir())


def test_json_holds_arrays_as_lists_and_nan_as_null(tmp_path):
    path = tmp_path / 'new' / 'figures.json'
    write_json(path, {'q': np.array([1.0, np.nan]), 3: (np.float64(np.inf), np.int64(2)), 'name': 'µm'})
    assert json.loads(path.read_text(encoding='utf-8')) == {'q': [1.0, None], '3': [None, 2], 'name': 'µm'}


@pytest.mark.parametrize(
    'write', [writable_folder, lambda path: write_json(path, {}), lambda path: write_text(path, '')]
)
def test_path_that_cannot_be_written_is_refused(write):
    with pytest.raises(PkmError, match=r'^/proc/nowhere: cannot be written: No such file or directory$'):
        write('/proc/nowhere')


def test_place_of_a_later_file_is_checked_without_a_trace(tmp_path):
    path = tmp_path / 'new' / 'figures.json'
    assert writable_file(path) == path
    assert not list(tmp_path.iterdir())
    (tmp_path / 'old.json').write_text('{}')
    assert writable_file(tmp_path / 'old.json').read_text() == '{}'


@pytest.mark.parametrize(
    ('name', 'reason'),
    [
        ('folder', 'is a folder; expected a file'),
        ('pipe', 'is no regular file; expected a file'),
        ('text/new.json', 'cannot be written'),
        ('x' * 5000, 'cannot be written: File name too long'),
    ],
)
def test_place_that_cannot_hold_a_file_is_refused(tmp_path, name, reason):
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'text').write_text('')
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(PkmError, match=reason):
        writable_file(tmp_path / name)


def test_step_that_fails_does_not_stop_those_after_it(tmp_path):
    """A full disk loses the picture, and neither table nor results."""
    done = []

    def fail():
        raise PkmError('learning.png: cannot be written: No space left on device')

    with pytest.raises(PkmError, match=r'learning\.png'):
        do_all(lambda: done.append('table'), fail, lambda: done.append('results'))
    assert done == ['table', 'results']
