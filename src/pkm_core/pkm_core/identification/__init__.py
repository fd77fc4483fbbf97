"""
Identification of the axis model P = L H, (7.18)-(7.20), from records of a moving axis.

excitation.py plans the experiments and axis_data.py holds the record of one. prediction_error.py fits L;
frequency_response.py and frequency_fit.py fit H; identify.py runs the fits in order. The experiments run in
simulation/experiment.py without ROS, or in the cell. No module here reads the truth of the simulated machine.
"""

from pkm_core.errors import PkmError


class IdentificationError(PkmError):
    """An excitation or a record is refused."""
