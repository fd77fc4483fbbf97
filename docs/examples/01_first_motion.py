"""
A first motion: plan it, simulate twelve learning cycles of the 4-DOF manipulator, plot both.

Prints the motion, the result, and for every joint the largest error in motion of the first and the last cycle [um].
They are the figures of `pkm run` with the same seed. Figures go to the folder given, by default a temporary one.
"""

import sys
import tempfile
from pathlib import Path

import pkm_core as pkm

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())

# %%
machine = pkm.load_machine('four_dof')
motion = pkm.plan(machine, 'four_dof_70ms')
print(motion)
motion.plot().savefig(folder / 'motion.png')

# %%
result = pkm.simulate(machine, motion, cycles=12, law='fourier_pid', seed=1)
print(result)
result.plot().savefig(folder / 'simulation.png')

# %%
first, last = (1e6 * result.max_dynamic_error[cycle] for cycle in (0, -1))
for joint, before, after in zip(result.joints, first, last, strict=True):
    print(f'{joint}: {before:.1f} um in cycle 1, {after:.1f} um in cycle {len(result)}')
