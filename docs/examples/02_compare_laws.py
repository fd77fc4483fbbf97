"""
Two learning laws on the same machine: the thesis's Fourier law and the inverse of the model.

Prints the largest error in motion of all joints [um] cycle by cycle for both laws, and the mean over cycles 8 to 12 of
three machines (seeds). Draws the errors over the cycles into laws.png in the folder given, by default a temporary one.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import pkm_core as pkm

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
laws, seeds, cycles = ('fourier', 'inverse'), (1, 2, 3), 12
machine = pkm.load_machine('four_dof')
motion = pkm.plan(machine, 'four_dof_70ms')

figure = Figure(layout='constrained')
axes = figure.subplots()
for color, law in enumerate(laws):
    runs = [pkm.simulate(machine, motion, cycles=cycles, law=law, seed=seed) for seed in seeds]
    worst = 1e6 * np.array([run.max_dynamic_error.max(axis=1) for run in runs])
    axes.semilogy(range(1, cycles + 1), worst.T, color=f'C{color}', marker='.', label=[law, '', ''])
    print(f'{law:8} seed 1:', ' '.join(f'{each:.1f}' for each in worst[0]))
    print(f'{law:8} cycles 8 to {cycles}, seeds {seeds}: {worst[:, 7:].mean():.2f} um')
axes.set(xlabel='cycle', ylabel='largest error in motion [um]', title=motion.name)
axes.grid(which='both', alpha=0.3)
axes.legend()
figure.savefig(folder / 'laws.png')
