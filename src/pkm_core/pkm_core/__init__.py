"""The mathematics of the parallel-manipulator cell; a plain Python library that knows nothing of ROS."""

import hashlib
import importlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any


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

if TYPE_CHECKING:
    from pkm_core.api.cycles import Cycle, read_cycle
    from pkm_core.api.identification import Identification, identify, run_experiments
    from pkm_core.api.motions import PlannedMotion, load_machine, plan
    from pkm_core.api.own import Controller, LearningLaw
    from pkm_core.api.simulation import Simulation, simulate
    from pkm_core.api.systems import LoopMargins, axis_system, loop_system, margins
    from pkm_core.errors import (
        BagError,
        ConfigError,
        LearningError,
        PkmError,
        TrajectoryError,
        WorkspaceError,
    )
    from pkm_core.identification import IdentificationError
    from pkm_core.machines.base import Machine

# in the order of docs/api.md
_MODULES = {
    'Machine': 'machines.base',
    'load_machine': 'api.motions',
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
__all__ = [
    'BagError',
    'ConfigError',
    'Controller',
    'Cycle',
    'Identification',
    'IdentificationError',
    'LearningError',
    'LearningLaw',
    'LoopMargins',
    'Machine',
    'PkmError',
    'PlannedMotion',
    'Simulation',
    'TrajectoryError',
    'WorkspaceError',
    'axis_system',
    'identify',
    'load_machine',
    'loop_system',
    'margins',
    'plan',
    'read_cycle',
    'run_experiments',
    'simulate',
]


def __getattr__(name: str) -> Any:
    """Load an exported name at its first use (PEP 562); nodes and `pkm` verbs import this package and need none."""
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    value = getattr(importlib.import_module(f'{__name__}.{_MODULES[name]}'), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
