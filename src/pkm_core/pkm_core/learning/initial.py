"""Feedforward of the first cycle of a motion, from a file of `store`."""

import numpy as np

from pkm_core.errors import LearningError
from pkm_core.learning import make_law
from pkm_core.learning.store import load, load_parameters, origin_of, read


def first_feedforward(path, machine, motion, law, gains, trajectory):
    """
    Return the feedforward (N, n) [V] of the first cycle of a motion, from the file `path`.

    It is the feedforward learned on the same motion, under any law. Under the basis law a file of that law is valid for
    every motion: its parameters give the feedforward, with friction at rest as after power-up.

    Parameters
    ----------
    path : str or Path
        File of `store.save`.
    machine : Machine
        The machine in use.
    motion : str
        Name of the motion.
    law : str
        Name of the law in use, or 'none'.
    gains : dict of str to RobustGains
        Of all joints.
    trajectory : SampledTrajectory
        The motion, in joints.

    Raises
    ------
    LearningError
        If it is not such a file, or was learned for another machine, motion, sample time or configuration.

    """
    origin, learned = origin_of(machine, motion, law, gains, trajectory), read(path)
    if learned.parameters and learned.origin.law == law and learned.origin.reference != origin.reference:
        parameters = load_parameters(path, origin)
        bound = make_law(law, machine, gains).with_reference(trajectory)
        return np.stack([bound.feedforward(j, parameters.get(j, {}), rested=True) for j in machine.joints], axis=1)
    feedforward = load(path, origin)
    if feedforward.shape != trajectory.position.shape:
        raise LearningError(f'{path}: feedforward has shape {feedforward.shape}; expected {trajectory.position.shape}')
    largest = np.abs(feedforward).max(initial=0.0)
    if largest > machine.voltage_limit:
        raise LearningError(f'{path}: feedforward of {largest:g} V; allowed {machine.voltage_limit:g} V')
    return feedforward
