"""The units in which the design tools show errors of a pose."""

import numpy as np


def units(machine):
    """Return [(factor from SI, unit)] of the machine's coordinates: um and mdeg."""
    return [(180e3 / np.pi, 'mdeg') if name == 'phi' else (1e6, 'um') for name in machine.coordinates]
