"""
Identify the axes from the bags of ordinary cycles: gain K and viscosity a, without any extra experiment.

Arguments: the folder of a run, by default runs/first (`bringup_scripts/run --out runs/first` makes it), and the folder
for the figures, by default a temporary one. Prints K [m/s^2/V] and a [1/s] of every axis with their standard
deviations and the values of config/model. Draws moves_JOINT.png. The first four bags are used.
"""

import sys
import tempfile
from pathlib import Path

import pkm_core as pkm
from pkm_core.control.model import load_model

run = Path(sys.argv[1] if len(sys.argv) > 1 else 'runs/first')
folder = Path(sys.argv[2] if len(sys.argv) > 2 else tempfile.mkdtemp())
bags = sorted(file.parent for file in run.rglob('metadata.yaml'))[:4]
if not bags:
    sys.exit(f'{run}: no bags; record some with: bringup_scripts/run --out {run}')

machine = pkm.load_machine('four_dof')
believed = load_model(machine)
print(f'{len(bags)} bags from {bags[0].name}')
for joint in machine.joints:
    fit, prior = pkm.identify(machine, joint, bags), believed[joint]
    gain = f'K = {fit.gain:.3f} +- {fit.gain_deviation:.3f} m/s^2/V (config/model {prior.gain:.3f})'
    print(f'{joint}: {gain}, a = {fit.viscosity:.2f} +- {fit.viscosity_deviation:.2f} 1/s ({prior.viscosity:.2f})')
    for warning in fit.warnings:
        print('  ', warning)
    fit.plot().savefig(folder / f'moves_{joint}.png')
