"""Figures without pyplot: nothing global is touched, and no screen is needed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pkm_core.plotting import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def empty_figure(width: float, height: float) -> Figure:
    """Return an empty figure of that size [inch]."""
    figure: Figure = new_figure(width, height)
    return figure
