"""Range checks whose errors name row, quantity, value and allowed range, in mm and deg."""

import numpy as np

from pkm_core.errors import WorkspaceError

ANGLES = ('phi',)  # all other coordinates of a machine are lengths


def check_last_axis(x, names, what):
    """Refuse `x` (array or Jet) unless its last axis has one entry per name."""
    if x.shape[-1:] != (len(names),):
        raise WorkspaceError(f'{what} has shape {x.shape}; expected (..., {len(names)}) for {", ".join(names)}')


def check_finite(values, names):
    """Refuse NaN and infinity in `values` (..., len(names))."""
    finite = np.isfinite(values)
    if not finite.all():
        *row, i = np.argwhere(~finite)[0]
        raise WorkspaceError(f'{_where(row)}{names[i]} = {values[(*row, i)]}; expected a finite number')


def check_between(values, low, high, names, reason, slack=0.0):
    """Refuse `values` (..., len(names)) unless low - slack < values < high + slack; NaN is refused too."""
    inside = (values + slack > low) & (values - slack < high)
    if not inside.all():
        *row, i = np.argwhere(~inside)[0]
        scale, unit = (180.0 / np.pi, 'deg') if names[i] in ANGLES else (1e3, 'mm')
        came, low, high = (
            scale * float(np.broadcast_to(bound, values.shape)[(*row, i)]) for bound in (values, low, high)
        )
        raise WorkspaceError(
            f'{_where(row)}{names[i]} = {came:.9g} {unit}; allowed {low:.9g} to {high:.9g} {unit} ({reason})'
        )


def _where(row):
    return f'row {", ".join(str(i) for i in row)}: ' if row else ''
