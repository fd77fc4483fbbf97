"""The mathematics of the parallel-manipulator cell; a plain Python library that knows nothing of ROS."""

import hashlib
import os
from pathlib import Path


def _kernel_cache():
    """
    Return the folder of numba's cache for the kernels as they stand.

    numba stamps a compiled function with its own source file only, so one that calls a kernel of another file would
    keep the old kernel after an edit there. A folder named after the text of all kernels cannot be stale.
    """
    folder = Path(__file__).resolve().parent
    sources = (path.read_bytes() for path in sorted(folder.rglob('*.py')))
    digest = hashlib.sha256(b''.join(text for text in sources if b'njit' in text))
    return folder / '__pycache__' / f'kernels-{digest.hexdigest()[:12]}'


os.environ.setdefault('NUMBA_CACHE_DIR', str(_kernel_cache()))
