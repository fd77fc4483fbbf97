"""Trajectories that are given in pieces: a jog is one cycle that is extended while it runs."""

from dataclasses import replace

import numpy as np

from pkm_core.errors import TrajectoryError
from pkm_core.motion.trajectory import DERIVATIVES, SampledTrajectory, checked_joints


def joined(trajectory, offset, piece):
    """
    Return `trajectory` with the rows from sample `offset` on replaced by those of `piece`.

    The whole counts as one move, which ends where that of `piece` ends.

    Raises
    ------
    TrajectoryError
        If `offset` is not within `trajectory`, or coordinates or sample times differ.

    """
    if not 0 < offset < len(trajectory):
        raise TrajectoryError(f'piece at sample {offset}; allowed 1 to {len(trajectory) - 1}')
    if piece.coordinates != trajectory.coordinates or piece.sample_time != trajectory.sample_time:
        raise TrajectoryError(
            f'piece at sample {offset}: of {piece.coordinates} every {piece.sample_time} s; expected '
            f'{trajectory.coordinates} every {trajectory.sample_time} s'
        )
    rows = {n: np.concatenate([getattr(trajectory, n)[:offset], getattr(piece, n)]) for n in DERIVATIVES}
    ends = offset + np.asarray(piece.move_ends)[-1:]
    return replace(trajectory, **rows, move_starts=np.asarray(trajectory.move_starts)[:1], move_ends=ends)


def rows_from(trajectory, first):
    """Return the rows of `trajectory` from sample `first` on; they count as one move."""
    rows = [values[first:] for values in trajectory.derivatives()]
    moves = np.array([0]), np.array([len(rows[0]) - 1])
    return SampledTrajectory(trajectory.sample_time, trajectory.coordinates, *rows, *moves)


def checked_piece(machine, trajectory, offset, piece):
    """
    Return `joined` of joint trajectories; `checked_joints` refuses the piece, or a jump before it.

    The two samples before the piece are checked with it, because a jump has no derivatives.
    """
    whole = joined(trajectory, offset, piece)
    checked_joints(machine, rows_from(whole, max(0, offset - 2)))
    return whole
