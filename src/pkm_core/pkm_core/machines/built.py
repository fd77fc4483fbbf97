"""
Measured lengths of one built machine: section `built` of a machine file, as written by `pkm calibrate`.

It enters the kinematics only; in the dynamics, 10 um on 70 mm would change masses by 1e-4. Design tools use the drawn
lengths, `Machine.drawing`.
"""

from typing import TYPE_CHECKING, Any

from pkm_core.config import Config, Length
from pkm_core.machines.base import PositiveLength
from pkm_core.machines.identity import Specimen
from pkm_core.machines.uncertainty import Uncertainty

_FARTHEST = 1e-3  # m; chosen: a larger deviation is an error in the file, not of the machine


class _Built(Config):
    specimen: Specimen | None = None  # of the measured machine; a file must name it, see `load_machine`
    uncertainty: Uncertainty | None = None  # of lengths and marks
    if TYPE_CHECKING:  # each mechanism has its own
        marks: Any

    @classmethod
    def names(cls):
        """Return the names of the lengths."""
        return tuple(name for name in cls.model_fields if name not in ('specimen', 'uncertainty', 'marks'))

    def lengths(self):
        """Return {name: length} [m] without the marks."""
        return {name: getattr(self, name) for name in self.names()}

    @classmethod
    def as_drawn(cls, geometry):
        """Return the drawn lengths of `geometry`, with all marks zero."""
        drawn = {name: drawn_length(geometry, name) for name in cls.names()}
        marks: Any = cls.model_fields['marks'].annotation
        return cls(**drawn, marks=marks(**dict.fromkeys(marks.model_fields, 0.0)))

    def check(self, geometry):
        """Raise ValueError if a value differs from the drawing `geometry` by more than `_FARTHEST`."""
        drawn = self.as_drawn(geometry)
        sections = (('built.', self.lengths(), drawn.lengths()), ('built.marks.', dict(self.marks), dict(drawn.marks)))
        for section, mine, other in sections:
            for name, value in other.items():
                if not abs(mine[name] - value) <= _FARTHEST:
                    raise ValueError(
                        f'{section}{name} {1e3 * mine[name]:g} mm; '
                        f'allowed {1e3 * (value - _FARTHEST):g} to {1e3 * (value + _FARTHEST):g} mm'
                    )


class PlanarMarks(Config):
    """Reading of each encoder minus the position of its slider."""

    d1: Length
    d3: Length


class PlanarBuilt(_Built):
    """Links 2, 4; offset of P."""

    l2: PositiveLength
    l4: PositiveLength
    dy: Length
    marks: PlanarMarks


class FourDofMarks(PlanarMarks):
    """Reading of each encoder minus the position of its slider."""

    d5: Length
    d7: Length


class FourDofBuilt(_Built):
    """Links 2 to 8; links 10, 12; offsets of Q, of P and of the end-effector."""

    l2: PositiveLength
    l4: PositiveLength
    l6: PositiveLength
    l8: PositiveLength
    k10: PositiveLength
    k12: PositiveLength
    dx: Length
    dy: Length
    dz: Length
    marks: FourDofMarks


def drawn_length(geometry, name):
    """Return the drawn value [m] of a link (`l4`, `k12`) or an offset (`dx`) of `geometry`."""
    links = {'l': 'l2', 'k': 'k10'}  # links of one kind have one drawn length
    return getattr(geometry, links.get(name[0], name))
