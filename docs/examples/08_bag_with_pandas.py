"""
Read the bag of one cycle as a pandas data frame.

Arguments: the folder of a run, by default runs/first (`bringup_scripts/run --out runs/first` makes it), and the folder
for the results, by default a temporary one. Prints the root mean square of error [um] and voltage [V] of every joint,
in motion and at rest, in the first and the last cycle of the run. Writes cycle.csv and cycle.png of the last one.
"""

import sys
import tempfile
from pathlib import Path

import pandas as pd

import pkm_core as pkm

run = Path(sys.argv[1] if len(sys.argv) > 1 else 'runs/first')
folder = Path(sys.argv[2] if len(sys.argv) > 2 else tempfile.mkdtemp())
bags = sorted(file.parent for file in run.rglob('metadata.yaml'))
if not bags:
    sys.exit(f'{run}: no bags; record some with: bringup_scripts/run --out {run}')

for bag in (bags[0], bags[-1]):
    cycle = pkm.read_cycle(bag)
    frame = pd.DataFrame(cycle.columns())
    phases = pd.Series('at rest', index=frame.index, name='phase')
    for start, end in zip(cycle.move_starts, cycle.move_ends, strict=True):
        phases.iloc[start : end + 1] = 'in motion'
    chosen = frame[[f'{joint} {signal}' for signal in ('error [m]', 'voltage [V]') for joint in cycle.joints]]
    rms = chosen.pow(2).groupby(phases).mean().pow(0.5)
    errors = rms.columns.str.endswith('[m]')
    rms.loc[:, errors] *= 1e6
    rms.columns = rms.columns.str.replace('[m]', '[um]')
    print(cycle, rms.T.round(3), sep='\n')
frame.to_csv(folder / 'cycle.csv', index=False)
cycle.plot().savefig(folder / 'cycle.png')
