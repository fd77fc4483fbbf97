"""The sets of models over which a loop is judged: gain, frequencies of the modes, and side of the zeros."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Uncertainty:
    """Factors of the gain and of all modes, 1 first, and whether the sign of the zeros' damping is unknown."""

    gains: tuple[float, ...]
    resonances: tuple[float, ...]
    both_signs: bool


GAIN_SPREAD = (1.0, 0.8, 1.2)  # payload, drive and identification
RESONANCE_SPREAD = (1.0, 0.95, 1.05)  # over the workspace
UNIDENTIFIED = Uncertainty(GAIN_SPREAD, RESONANCE_SPREAD, both_signs=True)
# chosen: an identified gain is within 0.5 %, a payload of 50 g adds 4 %, position and drive add 5 %; modes within 1 %
# and 2 % over the positions of the motor pair; the side of the zeros is identified
IDENTIFIED = Uncertainty((1.0, 0.9, 1.1), (1.0, 0.97, 1.03), both_signs=False)
