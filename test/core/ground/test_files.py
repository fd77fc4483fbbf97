"""Files that results are written to: folders that are created, JSON of arrays, and refusals."""

import json

import numpy as np
import pytest

from pkm_core.errors import PkmError
from pkm_core.files import writable_folder, write_json, write_text


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
