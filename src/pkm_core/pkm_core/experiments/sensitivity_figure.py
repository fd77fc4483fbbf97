"""Tornado figure of `pkm experiment sensitivity`."""

from pkm_core.experiments.sensitivity import LEVELS, MACHINES, by_effect
from pkm_core.plotting import new_figure, save

_COLORS = {'low': 'tab:blue', 'high': 'tab:orange'}
_SHOWN = 12  # constants per machine; the others have smaller effects
_BESIDE = {'low': -0.2, 'high': 0.2}  # offset of a bar from the row of its constant


def draw_sensitivity(folder, found):
    """Write sensitivity.png for the dict of `sensitivity`: bars from the shipped mean to that of each level."""
    figure = new_figure(11.0, 5.2)
    for axes, (machine, rows) in zip(figure.subplots(1, len(found)), found.items(), strict=True):
        shipped = rows['shipped', ''].mean
        for row, (constant, levels) in enumerate(by_effect(rows)[:_SHOWN]):
            for level, spread in levels.items():
                place, right = row + _BESIDE[level], spread.mean >= shipped
                axes.barh(place, spread.mean - shipped, left=shipped, color=_COLORS[level], height=0.38)
                axes.annotate(
                    constant.text(level),
                    (spread.mean, place),
                    ((3 if right else -3), 0),
                    textcoords='offset points',
                    ha='left' if right else 'right',
                    va='center',
                    fontsize=6,
                )
        listed = [constant.name for constant, _ in by_effect(rows)[:_SHOWN]]
        axes.set_yticks(range(len(listed)), listed, fontsize=8)
        axes.axvline(shipped, color='black', linewidth=0.8)
        axes.invert_yaxis()
        axes.margins(x=0.15)
        axes.grid(axis='x', alpha=0.3)
        axes.set(title=f'{MACHINES[machine]}: {shipped:.2f} um as shipped', xlabel='learned error, worst axis [um]')
    handles = [axes.barh(0, 0, color=_COLORS[level]) for level in LEVELS]
    figure.legend(handles, ['lower level', 'higher level'], loc='outside lower center', ncols=2)
    save(figure, folder, 'sensitivity')
