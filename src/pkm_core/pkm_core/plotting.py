"""Figures without a screen, on matplotlib's Agg canvas."""


def new_figure(width=7.0, height=5.5):
    """Return an empty matplotlib Figure of `width` by `height` [inch]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure


def save(figure, folder, name):
    """Write `figure` to `folder`/`name`.png."""
    figure.savefig(folder / f'{name}.png', dpi=110)
