"""Checks of the arguments of a learning law's update."""

import numpy as np

from pkm_core.errors import LearningError


def check_request(joint, joints, error, feedforward, iteration, sample_time, *, expected_time, minimum):
    """
    Raise `LearningError` unless the request is valid for a law for `joints` at `expected_time` [s].

    `minimum` is the least number of samples.
    """
    if joint not in joints:
        raise LearningError(f'learning: joint {joint!r} is unknown; known: {list(joints)}')
    if sample_time != expected_time:
        raise LearningError(f'learning {joint}: sample time is {sample_time} s; expected {expected_time} s')
    if iteration < 0:
        raise LearningError(f'learning {joint}: iteration is {iteration}; allowed from 0')
    for name, values in (('error', error), ('feedforward', feedforward)):
        if values.ndim != 1 or values.size < minimum:
            raise LearningError(f'learning {joint}: {name} has shape {values.shape}; expected (N,), N >= {minimum}')
        if not np.isfinite(values).all():
            index = int(np.argmin(np.isfinite(values)))
            raise LearningError(
                f'learning {joint}: {name} is {values[index]} at sample {index}; expected a finite value'
            )
    if error.size != feedforward.size:
        raise LearningError(
            f'learning {joint}: error has {error.size} samples, feedforward {feedforward.size}; expected the same'
        )
