"""The mathematics of the parallel-manipulator cell; a plain Python library that knows nothing of ROS."""

import importlib
import os
from typing import Any

from pkm_core.kernel_cache import kernel_cache as _kernel_cache

os.environ['NUMBA_CACHE_DIR'] = str(_kernel_cache())

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
