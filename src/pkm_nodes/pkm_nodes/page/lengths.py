"""The lengths of the machine that a cell announces, as a machine to draw."""

from pathlib import Path

from pkm_core.errors import PkmError
from pkm_core.machines.geometry import load_geometry
from pkm_core.yaml_text import YamlError, read_text


class Lengths:
    """
    Follows the geometry of a cell from its machine file on.

    Parameters
    ----------
    name : str
        Parameter `machine` of the cell; `PkmError` if it is no machine.

    Attributes
    ----------
    machine : Machine
        With the lengths in use; those of the start if the file of others cannot be read on this computer.
    words : str
        The lengths in use, for people.

    """

    def __init__(self, name):
        self._start = load_geometry(name)
        self._take(self._start)

    def announce(self, file, digest):
        """Use the lengths that a Geometry message names by `file` and hash `digest`."""
        if digest == self._start.digest:
            self._take(self._start)
            return
        try:
            found = self._start.exchanged(file, read_text(file))
        except (PkmError, OSError, UnicodeDecodeError, YamlError, ValueError) as error:
            self._refuse(file, f'cannot be read here: {getattr(error, "strerror", None) or error}')
            return
        if found.digest != digest:
            self._refuse(file, f'has hash {found.digest}; the cell uses {digest}')
            return
        self._take(found)

    def _take(self, geometry):
        self.machine = geometry.machine
        kind = f'calibrated, {Path(geometry.file).name}' if geometry.is_calibrated else 'as drawn'
        self.words = f'{kind}, hash {geometry.digest}'

    def _refuse(self, file, reason):
        self.machine = self._start.machine
        self.words = f'of {file}, which {reason}; shown are those of the start'
