"""Identification results as a printed table and as values for JSON."""

from itertools import zip_longest

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table


def show(console, title, found, notes=(), *, gain_unit='m/s²/V'):
    """Print the table of {joint: AxisIdentification} and all warnings; `notes` are further warnings."""
    console.print(_table(title, found, gain_unit))
    for text in (*notes, *(warning for axis in found.values() for warning in axis.warnings)):
        console.print(f'[yellow]warning:[/yellow] {escape(text)}', soft_wrap=True, highlight=False)


def _table(title, found, gain_unit):
    """Return the table; ± is one standard deviation."""
    table = Table(title=escape(title), title_justify='left', box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    headings = (
        *('axis', f'K\n\\[{gain_unit}]', 'a\n\\[1/s]', 'reso-\nnance\n\\[Hz]', 'damping'),
        *('anti-\nreso-\nnance\n\\[Hz]', 'damping', 'fit of\nleft-out\n\\[%]'),  # 80 columns
    )
    for heading in headings:
        table.add_column(heading, justify='left' if heading == 'axis' else 'right', no_wrap=True)
    for joint, axis in found.items():
        low, relative = axis.low, 100 * axis.low.deviations / np.abs((axis.low.gain, axis.low.viscosity))
        left = [(joint, f'{low.gain:#.4g} ±{relative[0]:.1f}%', f'{low.viscosity:#.4g} ±{relative[1]:.1f}%')]
        modes = [] if axis.high is None else zip(axis.high.modes, axis.high.deviations, strict=True)
        middle = [(f'{f:.2f}', f'{z:.5f}', f'{fa:.2f}', f'{za:.5f}') for (f, z, fa, za), _ in modes]
        right = [(f'L {low.fit_percent:.2f}',)] + ([] if axis.high is None else [(f'H {axis.high_percent:.1f}',)])
        rows = list(zip_longest(left, middle, right))
        for number, parts in enumerate(rows):
            cells = [part or ('',) * width for part, width in zip(parts, (3, 4, 1), strict=True)]
            table.add_row(*sum(map(tuple, cells), ()), end_section=number + 1 == len(rows))
    return table


def as_figures(found):
    """Return all results of {joint: AxisIdentification} as nested dicts in SI units and Hz."""
    return {joint: _axis_figures(axis) for joint, axis in found.items()}


def _axis_figures(axis):
    low, high, forces = axis.low, axis.high, axis.forces
    figures = {
        'gain': low.gain,
        'viscosity': low.viscosity,
        'covariance_gain_viscosity': low.covariance,
        'friction_V': low.friction,
        'offset_V': low.offset,
        'residual_m': low.residual,
        'fit_percent_left_out': low.fit_percent,
        'stretches_used': low.used,
        'stretches_left_out': low.held_out,
        'reference_as_instrument': low.instrument,
        'warnings': list(axis.warnings),
    }
    if forces is not None:
        figures['forces'] = forces.forces.model_dump()  # [V], [m], shares; see control/forces.py
        figures |= {'deviations_forces': forces.deviations, 'residual_forces_m': forces.residual}
    if high is not None:
        figures |= {
            'modes': high.modes,  # rows: resonance [Hz], damping, anti-resonance [Hz], damping
            'covariance_modes': high.covariance,
            'gains_of_sweeps': high.gains,
            'dead_time_s': high.delay,
            'misfit': high.misfit,
            'response_fit_percent_left_out': axis.high_percent,
            'lowest_gain_at': axis.lowest,
            'responses': [_response_figures(response) for response in axis.responses],
        }
    return figures


def _response_figures(response):
    return {
        'name': response.name,
        'position_m': response.position,
        'segments': response.segments,
        'initial_gain': response.initial_gain(),
        'excitation_as_instrument': response.instrument,
        'frequency_Hz': response.frequency,
        'plant_real': response.plant.real,
        'plant_imag': response.plant.imag,
        'deviation': response.deviation,
        'coherence': response.coherence,
    }
