"""Units of pose errors in the output of the design tools."""

import numpy as np


def units(machine):
    """Return [(factor from SI, unit)] of the machine's coordinates: um and mdeg."""
    return [(180e3 / np.pi, 'mdeg') if name == 'phi' else (1e6, 'um') for name in machine.coordinates]
