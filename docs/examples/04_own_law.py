"""
An own learning law: the error, low-pass filtered and some samples ahead, times one gain per joint.

Prints the largest error in motion of the joints [um] of cycles 1, 2, 4, 8 and 16 with the own law, the last also with
the project's 'fourier_pid', and what the monitors noticed. Draws the errors into own_law.png in the folder given, by
default a temporary one.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import pkm_core as pkm


class Ahead:
    """Gain over a Gaussian band, with a lead for the delay of the loop."""

    gain, lead, width = 4000.0, 4.5e-3, 60.0  # [V/m], [s], [Hz]

    def update(self, joint, error, feedforward, iteration, sample_time):
        """Return the feedforward (N,) [V] of the next cycle."""
        frequency = np.fft.rfftfreq(error.size, sample_time)
        weight = np.exp(-0.5 * (frequency / self.width) ** 2) * (frequency > 0)  # never the mean
        ahead = np.exp(2j * np.pi * frequency * self.lead)
        spectrum = np.fft.rfft(feedforward) * weight**0.1 + self.gain * weight * ahead * np.fft.rfft(error)
        return np.fft.irfft(spectrum, error.size)


folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
machine = pkm.load_machine('four_dof')
own, project = (pkm.simulate(machine, cycles=16, law=law) for law in (Ahead(), 'fourier_pid'))
for number in (1, 2, 4, 8, 16):
    print(f'{own.law}, cycle {number:2}:', ' '.join(f'{1e6 * each:.1f}' for each in own.max_dynamic_error[number - 1]))
print(f'{project.law}, cycle 16:', ' '.join(f'{1e6 * each:.1f}' for each in project.max_dynamic_error[-1]))
print('noticed:', own.notices or 'nothing')
own.plot().savefig(folder / 'own_law.png')
