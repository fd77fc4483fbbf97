"""
An own machine from YAML: an XY stage that is heavier, longer and measured finer than the one of this project.

The folder given, by default a temporary one, becomes its configuration: the file below, and truth, model and gains of
xy_stage under the new name. Prints the identified K and a of axis x, its margins on the copied model and with K and a
as identified, and the largest errors of a cycle [um]. Draws that cycle into cycle.png.
"""

import shutil
import sys
import tempfile
from pathlib import Path

import pkm_core as pkm

STAGE = """
mechanism: xy_stage
joints:
  x: {lower: 0 mm, upper: 60 mm, home: 30 mm}
  y: {lower: 0 mm, upper: 40 mm, home: 20 mm}
masses: {mx: 10.0 kg, my: 3.0 kg}
sample_time: 0.5 ms
encoder_resolution: 0.1 um
laser_sample_time: 0.8 ms
drive: {force_constant: 12.5 N/A, amplifier_gain: 5 A/V, peak_current: 12 A, voltage_limit: 10 V, speed_limit: 0.8 m/s}
"""
folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
for kind in ('machines', 'truth', 'model', 'control'):
    (folder / kind).mkdir(parents=True, exist_ok=True)
    shutil.copy(pkm.Configuration.of_environment().find(kind, 'xy_stage'), folder / kind / 'heavy_stage.yaml')
(folder / 'machines' / 'heavy_stage.yaml').write_text(STAGE)

machine = pkm.load_machine('heavy_stage', configuration=folder)
fit = pkm.identify(machine, 'x', pkm.run_experiments(machine, 'x', kind='low_frequency'))
print(fit)
print('believed  ', pkm.margins(machine, 'x'))
print('identified', pkm.margins(machine, 'x', model=fit.model))
result = pkm.simulate(machine, pkm.plan(machine, [[40e-3, 25e-3]], move_time=0.11))
print(result.cycle(1))
result.cycle(1).plot().savefig(folder / 'cycle.png')
