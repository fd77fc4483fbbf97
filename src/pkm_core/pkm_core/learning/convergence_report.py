"""The convergence test of a law as figures, table and plot."""

import numpy as np
from rich.markup import escape
from rich.table import Table

from pkm_core.learning.convergence import convergence
from pkm_core.learning.fourier import FourierLaw

MOVE = (10.0, 60.0)  # [Hz] band with most of the error of a 70 ms move


def convergence_figures(law):
    """
    Return {joint: figures} of `law`: the factor over frequency and its maximum; for a Fourier law also without advance.

    Frequencies in Hz; factors of the error per cycle, of the model and the worst of the perturbed models.
    """
    figures = {}
    for joint in law.gains:
        found = convergence(law, joint)
        move = (found.frequency >= MOVE[0]) & (found.frequency <= MOVE[1])
        figures[joint] = {
            'worst': found.worst,
            'worst_frequency_hz': found.worst_frequency,
            'worst_model': found.worst_model,
            'worst_in_move_band': float(found.factor[:, move].max()),
            'converges': found.worst < 1,
            'frequency_hz': found.frequency,
            'nominal_factor': found.factor[0],
            'worst_factor': found.factor.max(axis=0),
        }
        if isinstance(law, FourierLaw):
            printed = convergence(law.as_printed(), joint)
            above = printed.frequency[printed.factor.max(axis=0) > 1]
            figures[joint] |= {
                'advance_samples': law.advance[joint],
                'worst_as_printed': printed.worst,
                'diverges_as_printed_from_hz': float(above[0]) if above.size else None,
                'worst_factor_as_printed': printed.factor.max(axis=0),
            }
    return figures


def convergence_table(title, figures):
    """Return the table of `convergence_figures`."""
    table = Table(title=title, title_justify='left')
    fourier = any('advance_samples' in row for row in figures.values())
    headings = ['axis', 'worst factor\nper cycle', 'at [Hz]', f'worst in\n{MOVE[0]:g} to {MOVE[1]:g} Hz']
    headings += ['advance\n[samples]', 'worst without\nadvance', 'above 1\nfrom [Hz]'] if fourier else ['worst model']
    for heading in headings:
        table.add_column(escape(heading), justify='left' if heading in ('axis', 'worst model') else 'right')
    for joint, row in figures.items():
        cells = [joint, f'{row["worst"]:.3f}', f'{row["worst_frequency_hz"]:.1f}', f'{row["worst_in_move_band"]:.3f}']
        if fourier:
            cells += [str(row['advance_samples']), f'{row["worst_as_printed"]:.2f}']
            first = row['diverges_as_printed_from_hz']
            cells.append('never' if first is None else f'{first:.0f}')
        else:
            cells.append(row['worst_model'])
        table.add_row(*cells, style=None if row['converges'] else 'red')
    return table


def plot_convergence(title, figures, path):
    """Draw the factors over frequency, one panel per axis, into the PNG `path`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 1.2 + 2.1 * len(figures)), layout='constrained')
    FigureCanvasAgg(figure)
    panels = np.atleast_1d(figure.subplots(len(figures), 1, sharex=True, sharey=True))
    for axes, (joint, row) in zip(panels, figures.items(), strict=True):
        frequency = row['frequency_hz']
        axes.plot(frequency, row['worst_factor'], color='C0', linewidth=1, label='worst perturbed model')
        axes.plot(frequency, row['nominal_factor'], color='0.2', linewidth=1, label='model')
        if 'worst_factor_as_printed' in row:
            axes.plot(frequency, row['worst_factor_as_printed'], 'C3--', linewidth=1, label='worst, no advance')
        axes.axhline(1, color='C3', linewidth=0.8)
        axes.set(xscale='log', xlim=(1, frequency[-1]), ylim=(0, 1.8), ylabel=f'{joint}: factor')
        axes.grid(which='both', alpha=0.3)
    panels[0].set_title(title)
    panels[0].legend(loc='upper left', fontsize='small')
    panels[-1].set_xlabel('frequency [Hz]')
    figure.savefig(path, dpi=110)
