"""Files and folders that results are written to; a refusal names the path and the reason of the operating system."""

import json
import math
import os
from contextlib import contextmanager
from pathlib import Path

from pkm_core.errors import PkmError


@contextmanager
def refused_if_unwritable(path):
    """Turn an `OSError` of the block into a `PkmError` that names `path`."""
    try:
        yield
    except OSError as error:
        raise PkmError(f'{path}: cannot be written: {error.strerror or error}') from None


def writable_folder(path):
    """
    Return `path` as a folder in which files can be created; missing folders are created.

    Raises
    ------
    PkmError
        If it cannot be created, or a file cannot be created in it.

    """
    path = Path(path)
    with refused_if_unwritable(path):
        path.mkdir(parents=True, exist_ok=True)
        probe = path / '.pkm-probe'
        probe.touch()
        probe.unlink()
    return path


def writable_file(path):
    """
    Return `path` if a file can be written there later; nothing is created, and what it holds is kept.

    Raises
    ------
    PkmError
        If it is something else than a file, or its folder cannot be written or created.

    """
    path = Path(path)
    with refused_if_unwritable(path):
        if path.exists():
            if not path.is_file():
                raise PkmError(f'{path}: is {"a folder" if path.is_dir() else "no regular file"}; expected a file')
            path.open('r+b').close()
        place = path.parent
        while not place.exists():
            place = place.parent
        if not place.is_dir():
            raise PkmError(f'{path}: cannot be written: {place} is no folder')
        probe = place / f'.pkm-probe-{os.getpid()}'
        probe.touch()
        probe.unlink()
    return path


def do_all(*steps):
    """Call every function of `steps`, also after one has failed; then raise the first `PkmError` or `OSError`."""
    failures = []
    for step in steps:
        try:
            step()
        except (PkmError, OSError) as error:
            failures.append(error)
    if failures:
        raise failures[0]


def write_text(path, text):
    """Write `text` to the file `path` in UTF-8 and return the path; `PkmError` if it cannot be written."""
    path = Path(path)
    with refused_if_unwritable(path):
        path.write_text(text, encoding='utf-8')
    return path


def write_json(path, figures):
    """
    Write `figures` to the file `path` as JSON, indented by two spaces; missing folders are created.

    Parameters
    ----------
    path : Path or str
        The file.
    figures : dict, list, ndarray, number, str or None
        Nested values. Arrays and tuples become lists; a float that is NaN or infinite becomes null.

    Raises
    ------
    PkmError
        If the file cannot be written.

    """
    path = Path(path)
    with refused_if_unwritable(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(_plain(figures), indent=2, allow_nan=False) + '\n')


def _plain(value):
    """Return `value` in the types of JSON."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, 'tolist'):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
