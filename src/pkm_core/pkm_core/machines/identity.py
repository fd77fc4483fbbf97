"""
Identity of the built machine that a measurement or a calibration is of.

Lengths measured on one specimen are wrong for every other one. A file of measurements and a calibrated machine file
name their specimen, and a simulated machine with another seed or environment is refused.
"""

import re
from typing import Annotated, Literal

from pydantic import Field, model_validator

from pkm_core.config import Config
from pkm_core.errors import ConfigError

_TEXT = re.compile(r'(?P<machine>\w+), (?:measured machine|seed (?P<seed>\d+), environment (?P<environment>\w+))')


class Specimen(Config):
    """One built machine: a simulated one with its seed and environment, or a real one."""

    machine: Annotated[str, Field(description='name of the machine file')]
    origin: Annotated[Literal['simulated', 'measured machine'], Field(description='a simulation or a real machine')]
    seed: Annotated[int | None, Field(ge=0, description='of the simulated machine')] = None
    environment: Annotated[str | None, Field(description='of the simulated machine')] = None

    @model_validator(mode='after')
    def _a_simulated_one_is_complete(self):
        given = (self.seed is not None, self.environment is not None)
        if given != (self.origin == 'simulated',) * 2:
            expected = 'both' if self.origin == 'simulated' else 'neither'
            raise ValueError(
                f'{self.origin} with seed {self.seed}, environment {self.environment}; expected {expected}'
            )
        return self

    @classmethod
    def simulated(cls, machine, seed, environment):
        """Return the specimen that the simulation of the machine named `machine` builds for `seed`, `environment`."""
        return cls(machine=machine, origin='simulated', seed=int(seed), environment=environment)

    @classmethod
    def measured(cls, machine):
        """Return the specimen of a real machine named `machine`."""
        return cls(machine=machine, origin='measured machine')

    @classmethod
    def parse(cls, text):
        """
        Return the specimen whose `str` is `text`; `ConfigError` if it is none.

        Examples
        --------
        >>> str(Specimen.parse('planar, seed 3, environment hard'))
        'planar, seed 3, environment hard'

        """
        found = _TEXT.fullmatch(text.strip())
        if found is None:
            raise ConfigError(
                f"specimen: {text.strip()!r} given; expected 'MACHINE, seed N, environment NAME' or 'MACHINE, measured "
                "machine'"
            )
        if found['seed'] is None:
            return cls.measured(found['machine'])
        return cls.simulated(found['machine'], found['seed'], found['environment'])

    def __str__(self):
        if self.origin == 'simulated':
            return f'{self.machine}, seed {self.seed}, environment {self.environment}'
        return f'{self.machine}, {self.origin}'

    def check(self, other, what='the calibrated lengths'):
        """Raise `ConfigError`, which names both, if `other` is another `Specimen`."""
        if other != self:
            raise ConfigError(f'{what} are of specimen {self}; the machine in use is {other}; expected the same one')
