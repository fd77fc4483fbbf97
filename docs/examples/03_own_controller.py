"""
An own controller, PD with feedforward on every joint, against the project's robust control.

Prints the largest error in motion and the mean error at rest of both [um]. Without an integrator friction keeps the own
one off its target. Draws its cycle into cycle.png in the folder given, else a temporary one.
"""

import sys
import tempfile
from pathlib import Path

import pkm_core as pkm


class Pd:
    """A `pkm.Controller`."""

    before = 0.0  # error of the sample before [m]

    def load(self, trajectory, learned):
        """Take the next cycle."""
        self.reference, self.learned = trajectory, learned

    def update(self, index, measured):
        """Return the voltages (n,) [V]; the gains are in V/m, V s/m, V s/m and V s^2/m."""
        reference, error = self.reference, self.reference.position[index] - measured
        rate, self.before = (error - self.before) / reference.sample_time, error
        feedforward = 2.4 * reference.velocity[index] + 0.122 * reference.acceleration[index] + self.learned[index]
        return 6000.0 * error + 30.0 * rate + feedforward


folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
machine = pkm.load_machine('four_dof')
for controller in ('robust', Pd()):
    result = pkm.simulate(machine, 'four_dof_70ms', controller=controller)
    for joint, each in result.cycle(1).metrics().items():
        moving, resting = 1e6 * each.max_dynamic_error, 1e6 * each.steady_state_error
        print(f'{result.controller:6} {joint}: {moving:5.1f} um in motion, {resting:6.2f} um at rest')
result.cycle(1).plot().savefig(folder / 'cycle.png')
