"""Cache of compiled kernels: a folder that can be written, and damage that costs a compilation, never a run."""

import hashlib
import os
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path


def kernel_cache() -> Path:
    """
    Return the folder of numba's cache for the kernels as they stand; it can be written.

    numba stamps a compiled function with its own source file only, so one that calls a kernel of another file would
    keep the old kernel after an edit there. A folder named after the text of all kernels cannot be stale. It is beside
    the sources, or, if that folder is read-only or full, in a folder of this user in the temporary one.
    """
    package = Path(__file__).resolve().parent
    sources = (path.read_bytes() for path in sorted(package.rglob('*.py')))
    digest = hashlib.sha256(b''.join(text for text in sources if b'njit' in text))
    name = f'kernels-{digest.hexdigest()[:12]}'
    named = os.environ.get('NUMBA_CACHE_DIR')
    for folder in (Path(named) if named else package / '__pycache__' / name, _of_user() / name):
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder
    return Path(tempfile.mkdtemp(prefix='pkm-kernels-'))


def _of_user() -> Path:
    folder = Path(tempfile.gettempdir()) / f'pkm-kernels-{os.getuid()}'
    with suppress(OSError):
        folder.mkdir(mode=0o700)
    # a kernel is code: a folder of another user is not used
    if folder.is_symlink() or not folder.is_dir() or folder.stat().st_uid != os.getuid():
        return Path(tempfile.mkdtemp(prefix='pkm-kernels-'))
    return folder


def ignore_damage() -> None:
    """
    Make numba compile a kernel whose cached file is cut, and run without saving on a full disk.

    numba calls this before it looks into the cache (entry point `numba_extensions`); by itself it raises what pickle
    and the operating system raise.
    """
    from numba.core.caching import Cache

    @contextmanager
    def guard(cache):  # type: ignore[no-untyped-def]
        try:
            yield
        except Exception:
            with suppress(Exception):
                cache.flush()  # an empty index, so that the kernel is saved again

    Cache._guard_against_spurious_io_errors = guard  # type: ignore[method-assign, assignment]
