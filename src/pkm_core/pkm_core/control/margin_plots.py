"""Nyquist, Bode and sensitivity plots of loops, computed or measured, and margins over a parameter; matplotlib."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pkm_core.control.margins import design_grid, perturbed_models, unit_circle
from pkm_core.control.systems import plant_system


def model_loops(gains, model, sample_time):
    """Return (frequency [Hz], L of the model, [L of the perturbed models]) of a `PidLaw`, for the functions below."""
    grid = design_grid(sample_time)
    frequency = np.unique(np.concatenate([np.geomspace(2.0, grid[-1], 500), grid[(grid > 150) & (grid < 600)]]))
    z = unit_circle(frequency, sample_time)
    controller = gains.response(z, sample_time)
    loops = [
        controller * plant_system(each, sample_time)(z)
        for each in perturbed_models(model, uncertainty=gains.uncertainty)
    ]
    return frequency, loops[0], loops[1:]


def plot_margins(path, title, frequency, loop, perturbed=()):
    """
    Draw Nyquist, Bode and sensitivity of an open loop into the PNG `path`.

    Parameters
    ----------
    path : path-like
        File to write.
    title : str
        Title of the figure.
    frequency : ndarray, shape (m,)
        [Hz]
    loop : ndarray, shape (m,)
        L, computed or measured.
    perturbed : iterable of ndarray, shape (m,)
        Further loops, drawn thin.

    """
    figure = Figure(figsize=(13, 6.5), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    left, right = figure.subfigures(1, 2)  # type: ignore[misc]
    draw_nyquist(left.subplots(), loop, perturbed)
    magnitude, phase, sensitivity = right.subplots(3, 1, sharex=True)
    draw_bode(magnitude, phase, frequency, loop, perturbed)
    draw_sensitivity(sensitivity, frequency, loop, perturbed)
    figure.savefig(path, dpi=110)


def draw_nyquist(axes, loop, perturbed=()):
    """Draw L near -1 with the unit circle and the circle of |S| = 2."""
    for each in perturbed:
        axes.plot(each.real, each.imag, color='0.8', linewidth=0.6)
    axes.plot(loop.real, loop.imag, color='C0')
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 200))
    axes.plot(turn.real, turn.imag, color='k', linewidth=0.6, linestyle=':')
    axes.plot(turn.real / 2 - 1, turn.imag / 2, color='C3', linewidth=0.8, linestyle='--', label='|S| = 2')
    axes.plot(-1, 0, '+', color='C3')
    axes.set(xlim=(-2, 1.2), ylim=(-1.6, 1.6), xlabel='Re L', ylabel='Im L', aspect='equal')
    axes.grid(alpha=0.3)
    axes.legend(loc='upper right')


def draw_bode(magnitude, phase, frequency, loop, perturbed=()):
    """Draw |L| [dB] and its phase [deg], between -360 and 0, into two axes."""
    for each, color, width in (*((p, '0.8', 0.6) for p in perturbed), (loop, 'C0', None)):
        magnitude.semilogx(frequency, 20 * np.log10(np.abs(each)), color=color, linewidth=width)
        degrees = -np.mod(-np.degrees(np.angle(each)), 360)
        degrees[1:][np.abs(np.diff(degrees)) > 180] = np.nan  # no line across the plot where the phase wraps
        phase.semilogx(frequency, degrees, color=color, linewidth=width)
    magnitude.axhline(0, color='k', linewidth=0.6)
    phase.axhline(-180, color='k', linewidth=0.6)
    magnitude.set(ylabel='|L| [dB]')
    phase.set(ylabel='phase of L [deg]', yticks=[-360, -270, -180, -90, 0])
    for axes in (magnitude, phase):
        axes.grid(which='both', alpha=0.3)


def draw_sensitivity(axes, frequency, loop, perturbed=()):
    """Draw |S| and |T|."""
    for each in perturbed:
        axes.loglog(frequency, np.abs(1 / (1 + each)), color='0.8', linewidth=0.6)
    axes.loglog(frequency, np.abs(1 / (1 + loop)), color='C0', label='|S|')
    axes.loglog(frequency, np.abs(loop / (1 + loop)), color='C2', label='|T|')
    axes.axhline(1, color='k', linewidth=0.6)
    axes.set(xlabel='frequency [Hz]', ylabel='|S|, |T|', ylim=(0.02, 4))
    axes.grid(which='both', alpha=0.3)
    axes.legend(loc='lower right')


def plot_torque_limits(path, title, scans):
    """Draw the margins of `torque_limits.scan` over the natural frequency; `scans` is {joint: (flexible, rigid)}."""
    figure = Figure(figsize=(13, 4.5), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    panels = figure.subplots(1, 3)
    names = {'gain_margin': 'gain margin [dB]', 'phase_margin': 'phase margin [deg]', 'peak_sensitivity': 'Smax'}
    for axes, (name, label) in zip(panels, names.items(), strict=True):
        for colour, (joint, (flexible, rigid)) in enumerate(scans.items()):
            for scan, style, key in ((flexible, '-', joint), (rigid, ':', None)):
                values = np.where(scan['stable'], scan[name], np.nan)
                axes.plot(scan['natural_frequency'], values, style, color=f'C{colour}', label=key)
        axes.set(xlabel='natural frequency [Hz]', ylabel=label)
        axes.grid(alpha=0.3)
    panels[2].set_ylim(1, 6)
    panels[0].legend(title='solid: with modes, dotted: rigid')
    figure.savefig(path, dpi=110)
