"""
From records of a moving axis to its model P = L H, (7.18)-(7.20): excitation, fits, checks, pictures.

excitation.py says what to drive, loop.py drives it without ROS (a node can as well), axis_data.py is what every fit
takes, whoever recorded it. prediction_error.py fits L, frequency_response.py and frequency_fit.py fit H, and
identify.py puts them in order. Nothing here reads the truth of the simulated machine.
"""

from pkm_core.errors import PkmError


class IdentificationError(PkmError):
    """An excitation or a record to be fitted is refused."""
