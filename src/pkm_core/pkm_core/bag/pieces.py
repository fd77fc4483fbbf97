"""The planned trajectory in a bag: one message, or the pieces of a jog that the machine has driven."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from pkm_core.errors import BagError

SAFE_STOP, EXTENDED = 1, 2  # EncoderSample.mode


def extensions(samples):
    """Return the set of first samples of the driven pieces of a jog, by the EncoderSamples of one joint."""
    return {sample.index for sample in samples if sample.mode == EXTENDED}


def planned(messages, driven):
    """
    Return the trajectory of a cycle as one SampledTrajectory message.

    Parameters
    ----------
    messages : sequence of SampledTrajectory
        Of one topic, not empty: the last one, or with the pieces of a jog after it.
    driven : set of int
        `extensions`: other pieces arrived too late for the machine.

    Raises
    ------
    BagError
        If a driven piece is missing or is of other coordinates.

    """
    first = max(place for place, each in enumerate(messages) if not _offset(each) or not place)
    pieces = {_offset(each): each for each in messages[first + 1 :]}
    used = [messages[first], *(pieces[offset] for offset in sorted(driven & pieces.keys()))]
    if missing := sorted(driven - pieces.keys()):
        raise BagError(f'the pieces of the jog at samples {missing} are missing')
    if len(used) == 1:
        return used[0]
    columns = len(used[0].coordinates)
    rows = []
    for message, following in pairwise(used):
        if list(following.coordinates) != list(message.coordinates):
            raise BagError(f'the piece of the jog at sample {following.offset} has other coordinates')
        rows.append(message.position[: columns * (following.offset - _offset(message))])
    ends = used[-1].offset + np.asarray(used[-1].move_ends)[-1:]
    starts = np.asarray(used[0].move_starts)[:1]
    return replace(used[0], position=np.concatenate([*rows, used[-1].position]), move_starts=starts, move_ends=ends)


def _offset(message):
    """Return the first sample of a message; bags of older versions have no pieces."""
    return getattr(message, 'offset', 0)
