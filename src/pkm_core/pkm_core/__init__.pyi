from pkm_core.api.cycles import Cycle, read_cycle
from pkm_core.api.identification import Identification, identify, run_experiments
from pkm_core.api.motions import PlannedMotion, load_machine, plan
from pkm_core.api.own import Controller, LearningLaw
from pkm_core.api.simulation import Simulation, simulate
from pkm_core.api.systems import LoopMargins, axis_system, loop_system, margins
from pkm_core.config import Configuration
from pkm_core.errors import BagError, ConfigError, LearningError, PkmError, TrajectoryError, WorkspaceError
from pkm_core.identification import IdentificationError
from pkm_core.machines.base import Machine

__all__ = [
    'BagError',
    'ConfigError',
    'Configuration',
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
