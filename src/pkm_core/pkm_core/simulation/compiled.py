"""
A cycle of plant and robust controllers in one compiled loop: the functions of the single ticks, so the same bits.

Tick by tick, half of the time goes into calling compiled functions from Python.
"""

from numba import njit

from pkm_core.control.robust import step
from pkm_core.plant.tick import advance


@njit(cache=True, error_model='numpy')
def _close(arguments, place, noise, row, substeps, resolution, axes, index, stop, counts, voltage, error):
    """Run samples `index` to `stop` or until something happens; return the next sample and what happened."""
    event = 0
    while index < stop and event == 0:
        for i in range(len(axes)):
            reference, feedforward, parameters, state = axes[i]
            counts[index, i] = place[i]
            measured = place[i] * resolution
            voltage[index, i], error[index, i] = step(index, measured, reference, feedforward, parameters, state)
        event = advance(*arguments, voltage[index], noise, row, substeps, False)
        index += 1
        row += 1
    return index, event


def run_cycle(plant, controllers, counts, voltage, error):
    """
    Run a loaded cycle of `JointControllers` on a `Plant` and fill the records of its samples.

    Parameters
    ----------
    plant : Plant
        Its cycle is started.
    controllers : JointControllers
        They have loaded a cycle of as many samples as the records.
    counts, voltage, error : ndarray, shape (N, n)
        Readings [counts], answers [V] and errors [m]; after a fault of the plant the rest stays as it was.

    Returns
    -------
    samples : int
        N, or how many were run until the plant had a fault.

    """
    axes = tuple(axis.compiled() for axis in controllers.axes)
    resolution = plant.machine.encoder_resolution

    def loop(arguments, place, noise, row, substeps, index, stop):
        return _close(arguments, place, noise, row, substeps, resolution, axes, index, stop, counts, voltage, error)

    return plant.run(loop, len(counts))
