"""
A cycle of plant and controllers of single axes in one compiled loop, with the same functions and bits as single ticks.

With single ticks, half of the time is spent on calls of compiled functions from Python.
"""

import numpy as np
from numba import njit

from pkm_core.control import observer, robust
from pkm_core.control.observer import ObserverController
from pkm_core.plant.tick import advance


@njit(cache=True, error_model='numpy')
def _close(arguments, place, noise, row, substeps, resolution, observers, axes, index, stop, counts, voltage, error):
    """Run samples `index` to `stop` or to the first event; return the next sample and the event."""
    event = 0
    while index < stop and event == 0:
        for i in range(len(axes)):
            reference, feedforward, parameters, state = axes[i]
            counts[index, i] = place[i]
            measured = place[i] * resolution
            if observers[i]:
                volts, off = observer.step(index, measured, reference, feedforward, parameters, state)
            else:
                volts, off = robust.step(index, measured, reference, feedforward, parameters, state)
            voltage[index, i], error[index, i] = volts, off
        event = advance(*arguments, voltage[index], noise, row, substeps, False)
        index += 1
        row += 1
    return index, event


def run_cycle(plant, controllers, counts, voltage, error):
    """
    Run a loaded cycle of `JointControllers` on a `Plant` and fill the records, one row per sample.

    Parameters
    ----------
    plant : Plant
        With its cycle started.
    controllers : JointControllers
        With a loaded cycle of N samples.
    counts, voltage, error : ndarray, shape (N, n)
        Readings [counts], commands [V] and errors [m]; the rows after a fault of the plant are not changed.

    Returns
    -------
    samples : int
        Number of samples run: N, or fewer after a fault of the plant.

    """
    axes = tuple(axis.compiled() for axis in controllers.axes)
    observers = np.array([isinstance(axis, ObserverController) for axis in controllers.axes])
    resolution = plant.machine.encoder_resolution

    def loop(arguments, place, noise, row, substeps, index, stop):
        return _close(
            arguments, place, noise, row, substeps, resolution, observers, axes, index, stop, counts, voltage, error
        )

    return plant.run(loop, len(counts))
