"""
Bode diagram of an axis: the measured response, and by python-control the model of config/model and the fitted one.

Measured is a swept sine on a jog, simulated, or what the bags of `pkm identify-cell` in the folder given second hold.
The first argument is the folder for bode.png, else a temporary one. Prints how far both models are from the measured
response over the sweep, mean [dB] and [deg], and the identified resonances [Hz].
"""

import sys
import tempfile
from pathlib import Path

import control
import numpy as np
from matplotlib.figure import Figure

import pkm_core as pkm

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
bags = sorted(file.parent for file in Path(sys.argv[2]).rglob('metadata.yaml')) if len(sys.argv) > 2 else []
machine = pkm.load_machine('four_dof')
fit = pkm.identify(machine, 'd3', bags or pkm.run_experiments(machine, 'd3'))
measured = fit.measured_response()
models = {'config/model': pkm.axis_system(machine, 'd3'), 'fitted': pkm.axis_system(machine, 'd3', model=fit.model)}

magnitude, phase = (figure := Figure(figsize=(8, 6), layout='constrained')).subplots(2, 1, sharex=True)
for name, system in {'measured': None, **models}.items():
    response = measured if system is None else control.frequency_response(system, measured.omega)
    hertz, values, style = response.omega / (2 * np.pi), response.complex, '-' if system else '.'
    magnitude.semilogx(hertz, 20 * np.log10(abs(values)), style, label=name)
    phase.semilogx(hertz, np.degrees(np.unwrap(np.angle(values))), style)
    if system:
        off = np.log(values / measured.complex)
        decibels, degrees = 20 / np.log(10) * off.real, np.degrees(off.imag)
        print(f'{name:12} {np.mean(abs(decibels)):.2f} dB, {np.mean(abs(degrees)):.2f} deg from the measured response')
print('resonances:', ', '.join(f'{each:.1f} Hz' for each in fit.modes[:, 0]))
magnitude.set(ylabel='|P| [dB re 1 m/V]', title=str(fit))
phase.set(ylabel='phase [deg]', xlabel='frequency [Hz]')
magnitude.legend()
figure.savefig(folder / 'bode.png')
