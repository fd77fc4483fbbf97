"""Errors of one cycle in the joints and at the end point, by forward kinematics of the encoders and by the laser."""

from dataclasses import dataclass

import numpy as np

from pkm_core.machines.checks import ANGLES
from pkm_core.motion.metrics import axis_metrics

# [m] chosen; a rotation counts as the displacement on this radius; that of the thesis's laser is unknown
ARM = 50e-3


@dataclass(frozen=True)
class Histories:
    """Reference and measurement over one cycle; one row per sample, one column per axis."""

    cycle: int
    names: tuple[str, ...]
    sample_time: float  # [s]
    reference: np.ndarray  # (N, c) [m, rad]
    measured: np.ndarray  # (N, c) [m, rad]
    error: np.ndarray  # (N, c) [m] reference minus measured, rotations on `ARM`
    move_starts: np.ndarray  # (moves,) [samples]
    move_ends: np.ndarray

    def metrics(self):
        """Return {axis: AxisMetrics} over the whole cycle."""
        return {
            name: axis_metrics(error, self.move_starts, self.move_ends, self.sample_time)
            for name, error in zip(self.names, self.error.T, strict=True)
        }

    def metrics_of_moves(self):
        """Return {axis: [AxisMetrics of each move and the rest after it]}."""
        stops = [*self.move_starts[1:], len(self.error)]
        moves = list(zip(self.move_starts, self.move_ends, stops, strict=True))

        def metrics(error, start, end, stop):
            found = axis_metrics(error[:stop], [start], [end], self.sample_time)
            return found if np.ptp(self.reference[start : end + 1], axis=0).any() else found.without_settling()

        return {
            name: [metrics(error, *move) for move in moves]
            for name, error in zip(self.names, self.error.T, strict=True)
        }


def joint_histories(record):
    """Return the `Histories` of the joints of a `CycleRecord`."""
    return Histories(
        cycle=record.cycle,
        names=record.joints,
        sample_time=record.sample_time,
        reference=record.reference,
        measured=record.position,
        error=record.error,
        move_starts=record.move_starts,
        move_ends=record.move_ends,
    )


def end_point_histories(record, machine):
    """Return the `Histories` of the pose of a `CycleRecord` by forward kinematics of its encoders."""
    measured = machine.forward(record.position)
    return Histories(
        cycle=record.cycle,
        names=record.coordinates,
        sample_time=record.sample_time,
        reference=record.pose_reference,
        measured=measured,
        error=(record.pose_reference - measured) * lengths(record.coordinates),
        move_starts=record.move_starts,
        move_ends=record.move_ends,
    )


def laser_histories(record):
    """
    Return the `Histories` of the displacements measured by the laser, or None without a laser.

    Reference and measurement count from the rest before the first move, because the datum of the laser is unknown.
    """
    if len(record.laser_time) < 2:
        return None
    sample_time = float(np.median(np.diff(record.laser_time)))
    starts, ends = (
        np.searchsorted(record.laser_time, samples * record.sample_time)
        for samples in (record.move_starts, record.move_ends)
    )
    reference, measured = laser_path(
        record.laser_time, record.laser, record.pose_reference, record.sample_time, record.move_starts[0]
    )
    return Histories(
        cycle=record.cycle,
        names=record.coordinates,
        sample_time=sample_time,
        reference=reference,
        measured=measured,
        error=(reference - measured) * lengths(record.coordinates),
        move_starts=starts,
        move_ends=ends,
    )


def laser_path(laser_time, laser, pose_reference, sample_time, first_move):
    """
    Return reference and measurement (K, m) [m, rad] at the times of the laser, from the rest before the first move.

    Parameters
    ----------
    laser_time, laser : ndarray, shape (K,), (K, m)
        Since the start of the cycle [s]; displacement [m, rad].
    pose_reference : ndarray, shape (N, m)
        At the ticks [m, rad].
    sample_time : float
        Of the ticks [s].
    first_move : int
        Sample at which the first move starts.

    """
    time = np.arange(len(pose_reference)) * sample_time
    reference = np.stack([np.interp(laser_time, time, column) for column in pose_reference.T], axis=1)
    at_rest = slice(max(1, np.searchsorted(laser_time, first_move * sample_time)))
    return reference - pose_reference[0], laser - np.mean(laser[at_rest], axis=0)


def lengths(coordinates):
    """Return the factors from errors of a pose to lengths [m]."""
    return np.array([ARM if name in ANGLES else 1.0 for name in coordinates])
