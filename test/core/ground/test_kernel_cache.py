"""numba's cache: read-only, without space, and with cut files; a run never fails for it."""

import os
import subprocess
import sys

import pytest

from pkm_core.kernel_cache import kernel_cache

COMPILES = """
import pkm_core
from numba import njit

@njit(cache=True)
def double(value):
    return 2 * value

print(double(21), double.stats.cache_hits[double.signatures[0]] if double.stats.cache_hits else 0)
"""


@pytest.fixture
def compiled(tmp_path):
    """Return a function that runs a module with a kernel in its own process: (its result, hits of the cache)."""
    module, cache = tmp_path / 'kernel.py', tmp_path / 'cache'
    module.write_text(COMPILES)

    def run():
        words = [sys.executable, str(module)]
        environment = os.environ | {'NUMBA_CACHE_DIR': str(cache)}
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr
        return tuple(map(int, done.stdout.split()))

    return run, cache


def test_cut_files_of_the_cache_cost_one_compilation(compiled):
    run, cache = compiled
    assert run() == (42, 0)
    for ending in ('nbi', 'nbc'):
        for path in cache.rglob(f'*.{ending}'):
            os.truncate(path, 20)
        assert run() == (42, 0)
    assert run() == (42, 1)


def test_folder_that_cannot_be_written_is_replaced(monkeypatch, tmp_path):
    monkeypatch.setenv('NUMBA_CACHE_DIR', '/proc/cache')
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path))
    folder = kernel_cache()
    assert folder.parent == tmp_path / f'pkm-kernels-{os.getuid()}'
    assert folder.parent.stat().st_mode & 0o777 == 0o700


def test_temporary_folder_of_another_user_is_not_used(monkeypatch, tmp_path):
    """A kernel is code."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', '/proc/cache')
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path))
    (tmp_path / f'pkm-kernels-{os.getuid()}').symlink_to('/tmp')
    assert kernel_cache().parent.parent == tmp_path
    assert kernel_cache().parent.name != f'pkm-kernels-{os.getuid()}'
