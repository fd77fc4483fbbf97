"""The mathematics of the parallel-manipulator cell; a plain Python library that knows nothing of ROS."""

import hashlib
import importlib
import os
from pathlib import Path
from typing import Any


def _kernel_cache() -> Path:
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

# where each exported name is; __init__.pyi has the same names for type checkers
_MODULES = {
    'Machine': 'machines.base',
    'load_machine': 'api.motions',
    'Configuration': 'config',
    'plan': 'api.motions',
    'PlannedMotion': 'api.motions',
    'simulate': 'api.simulation',
    'Simulation': 'api.simulation',
    'Controller': 'api.own',
    'LearningLaw': 'api.own',
    'read_cycle': 'api.cycles',
    'Cycle': 'api.cycles',
    'axis_system': 'api.systems',
    'loop_system': 'api.systems',
    'margins': 'api.systems',
    'LoopMargins': 'api.systems',
    'run_experiments': 'api.identification',
    'identify': 'api.identification',
    'Identification': 'api.identification',
    'PkmError': 'errors',
    'ConfigError': 'errors',
    'WorkspaceError': 'errors',
    'TrajectoryError': 'errors',
    'LearningError': 'errors',
    'BagError': 'errors',
    'IdentificationError': 'identification',
}
__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    """Load an exported name at its first use (PEP 562); nodes and `pkm` verbs import this package and need none."""
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    value = getattr(importlib.import_module(f'{__name__}.{_MODULES[name]}'), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
