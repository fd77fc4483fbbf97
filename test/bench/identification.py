"""
This identification compared with other software on the same data: accuracy against the truth, and time.

    .venv/bin/uv pip install --require-hashes -r requirements/bench.txt   # once, the set-up does not need it
    .venv/bin/python test/bench/identification.py --json runs/bench_identification.json

The records are those of `pkm identify`: slow moves and sweeps of every axis in closed loop on the simulated machines
with every imperfection. The input of the other methods is described in identification_others.py. Anti-resonances
outside the band of the sweep are listed separately. A missing value, or an error over 100 %, counts as 100 %. A table
has the median and the worst error over all axes and seeds, the time of one thread without reading the data, and both as
multiples of this identification.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from identification_others import (
    BAND,
    csd_high,
    csd_response,
    nfoursid_high,
    nfoursid_low,
    quietly,
    sippy_high,
    sippy_low,
)
from rich.console import Console
from rich.table import Table

from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.identification.coupling import coupling_factor
from pkm_core.identification.excitation import slow_moves, sweeps
from pkm_core.identification.frequency_fit import Surroundings, fit_high_frequency
from pkm_core.identification.frequency_response import estimate_response
from pkm_core.identification.identify import LOOP_DELAY
from pkm_core.identification.partial_fractions import mode_rows
from pkm_core.identification.prediction import KnownDynamics
from pkm_core.identification.prediction_error import fit_low_frequency
from pkm_core.machines import load_machine
from pkm_core.plant.truth import load_truth
from pkm_core.simulation.experiment import SimulatedCell

LINES = np.arange(41, 256) / 0.512  # [Hz] of the sweep, strictly within its band
MACHINES = ('planar', 'four_dof', 'xy_stage')


class Axis:
    """The data of one joint, its prior knowledge and its true values."""

    def __init__(self, machine, joint, seed, cell, models, gains):
        model = models[joint]
        truth = load_truth(machine, 'nominal')[0].axes[joint]
        self.name = f'{machine.name} {joint}, seed {seed}'
        self.true_low = np.array([
            (truth.gain or _thrust_over_mass(machine, joint)) * (1 + truth.gain_error),
            truth.viscosity * (1 + truth.viscosity_error),
        ])  # fmt: skip
        self.modes = mode_rows(truth.modes)
        self.in_band = np.tile(self.modes[:, 2:3] < BAND[1], 2)
        self.moves = cell.run(slow_moves(machine, joint, model)).axis(machine, joint)
        records = [cell.run(each) for each in sweeps(machine, joint, model, gains[joint])]
        self.sweeps = [record.axis(machine, joint) for record in records]
        self.lines = LINES
        self.factors = [  # effect of the other axes on the response, by design; for all methods
            coupling_factor(machine, machine.joints.index(joint), record.excited_position(), LINES, models, gains)
            for record in records
        ]
        true = Surroundings(self.true_low[1], self.moves.sample_time, model.current_loop)
        self.true_response = true.response(LINES, self.true_low[0], LOOP_DELAY, self.modes)
        self.loop = KnownDynamics(model.current_loop, LOOP_DELAY)
        viscosity = fit_low_frequency([self.moves], self.loop).viscosity
        self.surroundings = Surroundings(viscosity, self.moves.sample_time, model.current_loop, LOOP_DELAY)
        self.responses = our_responses(self)
        found = fit_high_frequency(self.responses, self.surroundings, len(self.modes))
        self.found = KnownDynamics(model.current_loop, found.delay, found.modes)


def _thrust_over_mass(machine, joint):
    axis = machine.joints.index(joint)
    return machine.thrust_per_volt / machine.mass_matrix(machine.home)[axis, axis]


def ours_low(axis):
    """Return (K, a) by pkm_core with the modes of its own fit to the sweeps."""
    fit = fit_low_frequency([axis.moves], axis.found)
    return fit.gain, fit.viscosity


def ours_low_alone(axis):
    """Return (K, a) by pkm_core from the moves alone, as for the other methods."""
    fit = fit_low_frequency([axis.moves], axis.loop)
    return fit.gain, fit.viscosity


def our_responses(axis):
    """Return the responses at LINES by pkm_core, with the other axes held."""
    found = zip((estimate_response(data, (LINES[0], LINES[-1])) for data in axis.sweeps), axis.factors, strict=True)
    return [replace(each, plant=each.plant / factor, deviation=each.deviation / abs(factor)) for each, factor in found]


def ours_response(axis):
    """Return the responses (sweeps, F) by pkm_core."""
    return [response.plant for response in our_responses(axis)]


def ours_high(axis):
    """Return the modes by pkm_core."""
    return fit_high_frequency(our_responses(axis), axis.surroundings, len(axis.modes)).modes


LOW = {
    'pkm_core': ours_low,
    'pkm_core, moves alone': ours_low_alone,
    'sippy ARX': sippy_low('ARX', moving=False),
    'sippy ARX, moving': sippy_low('ARX', moving=True),
    'sippy ARMAX': sippy_low('ARMAX', moving=False),
    'sippy ARMAX, moving': sippy_low('ARMAX', moving=True),
    'sippy OE': sippy_low('OE', moving=False),
    'nfoursid, moving': nfoursid_low,
}
RESPONSE = {
    'pkm_core': ours_response,
    'csd S_yr/S_ur': csd_response(instrument=True),
    'csd S_yu/S_uu': csd_response(instrument=False),
}
HIGH = {
    'pkm_core': ours_high,
    'csd S_yr/S_ur + our fit': csd_high(instrument=True),
    'csd S_yu/S_uu + our fit': csd_high(instrument=False),
    'sippy N4SID': sippy_high('N4SID', 10),
    'sippy CVA': sippy_high('CVA', 10),
    'sippy PARSIM-K': sippy_high('PARSIM-K', 8),
    'nfoursid': nfoursid_high(10),
}


def errors_low(axis, answer):
    """Return the errors [%] of K and a, one row each."""
    return {'K': [answer[0] / axis.true_low[0] - 1], 'a': [answer[1] / axis.true_low[1] - 1]}


def errors_response(axis, responses):
    """Return the errors of the responses, in size and phase together, below and above the first resonance."""
    off = np.abs(np.array(responses) / axis.true_response - 1)
    low = LINES < 200.0
    return {'80-200 Hz': off[:, low].ravel(), '200-500 Hz': off[:, ~low].ravel()}


def errors_high(axis, modes):
    """Return the errors of the modes by kind."""
    off, near = modes / axis.modes - 1, axis.in_band
    return {
        'resonance': off[:, 0],
        'its damping': off[:, 1],
        'anti-resonance': off[:, 2][near[:, 0]],
        'its damping ': off[:, 3][near[:, 0]],
        'beyond band': off[:, 2][~near[:, 0]],
        'its damping  ': off[:, 3][~near[:, 0]],
    }


def measure(methods, axes, errors, nothing):
    """Return {method: {'errors': {kind: (values,) [%]}, 'milliseconds': median}}."""
    results = {}
    for name, method in methods.items():
        quietly(method, axes[0])  # imports and first calls are not timed
        gathered, times = {}, []
        for axis in axes:
            began = time.thread_time()
            answer = quietly(method, axis)
            times.append(1e3 * (time.thread_time() - began))
            for kind, values in errors(axis, nothing(axis) if answer is None else answer).items():
                gathered.setdefault(kind, []).extend(np.minimum(np.nan_to_num(np.abs(values), nan=1.0), 1.0) * 100)
        results[name] = {'errors': gathered, 'milliseconds': float(np.median(times))}
    return results


def show(console, title, results):
    """Print one table: median and worst errors, times, and both as multiples of this identification."""
    ours = results['pkm_core']
    kinds = list(ours['errors'])
    table = Table(title=f'{title}: error [%] median, worst', title_justify='left')
    table.add_column('method', no_wrap=True)
    for kind in (*kinds, 'ms', 'time x', 'error x'):
        table.add_column(kind, justify='right')
    for name, result in results.items():
        values = {kind: np.array(result['errors'][kind]) for kind in kinds}
        cells = [f'{np.median(each):.2g}, {each.max():.2g}' for each in values.values()]
        ratio = [np.median(values[kind]) / np.median(ours['errors'][kind]) for kind in kinds]
        result['time_over_ours'] = result['milliseconds'] / ours['milliseconds']
        result['median_error_over_ours'] = dict(zip(kinds, map(float, ratio), strict=True))
        table.add_row(
            *(name, *cells, f'{result["milliseconds"]:.0f}', f'{result["time_over_ours"]:.1f}'),
            f'{min(ratio):.2g} to {max(ratio):.2g}',
        )
    console.print(table)


def main():
    """Print both tables and write all errors."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument('--seeds', type=int, nargs='+', default=[1, 2])
    options.add_argument('--json', type=Path)
    options = options.parse_args()
    axes = []
    for name in MACHINES:
        machine = load_machine(name)
        models, gains = load_model(machine), load_control(machine)
        for seed in options.seeds:
            cell = SimulatedCell(machine, gains, seed)
            axes += [Axis(machine, joint, seed, cell, models, gains) for joint in machine.joints]
    console = Console(width=180)
    low = measure(LOW, axes, errors_low, lambda _: (np.nan, np.nan))
    show(console, 'K and a', low)
    response = measure(RESPONSE, axes, errors_response, lambda axis: np.full((len(axis.sweeps), LINES.size), np.nan))
    show(console, 'response', response)
    high = measure(HIGH, axes, errors_high, lambda axis: np.full_like(axis.modes, np.nan))
    show(console, 'modes', high)
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(
            json.dumps({'low': low, 'response': response, 'high': high}, indent=2) + '\n', encoding='utf-8'
        )


if __name__ == '__main__':
    main()
