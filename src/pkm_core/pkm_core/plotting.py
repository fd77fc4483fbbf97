"""Pictures without a screen, on matplotlib's Agg canvas, and the units that the design tools show."""

import numpy as np


def units(machine):
    """Return [(factor from SI, unit)] of the machine's coordinates: um and mdeg."""
    return [(180e3 / np.pi, 'mdeg') if name == 'phi' else (1e6, 'um') for name in machine.coordinates]


def new_figure(width=7.0, height=5.5):
    """Return an empty matplotlib Figure of that size [inch]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure


def save(figure, folder, name):
    """Write `figure` to `folder`/`name`.png."""
    figure.savefig(folder / f'{name}.png', dpi=110)
