"""Measurements of a calibration on the simulated machine without ROS, from encoders and laser only."""

import numpy as np

from pkm_core.control.robust import load_control
from pkm_core.design.calibration_motion import calibration_motion
from pkm_core.design.rests import joined, rests_from_arrays
from pkm_core.machines.identity import Specimen
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles


def measure_poses(machine, poses, laser, seed, environment='nominal', gains=None, rise=None):
    """
    Return the averaged `Measurements` at `poses` (N, m) [m, rad] of the simulated machine of `seed`, `environment`.

    Every cycle of the calibration motion begins at power-up, which is the datum of the laser.

    Parameters
    ----------
    machine : Machine
        Its inverse kinematics command the poses.
    poses : ndarray, shape (N, m)
        [m, rad].
    laser : LaserConfig
        Resolution of the laser, and the error of an encoder.
    seed, environment : int, str
        Of the plant.
    gains : dict, optional
        Of the controllers; by default those of the machine's configuration.
    rise : array_like, optional
        Temperatures of the plant, see `Plant`.

    Raises
    ------
    PkmError
        If a pose is out of reach, the machine stops with a fault, or a rest is refused.

    """
    gains = load_control(machine) if gains is None else gains
    specimen = Specimen.simulated(machine.name, seed, environment)
    parts = []
    for cycle in calibration_motion(machine, poses):
        joints = to_joints(machine, cycle.trajectory)
        records = run_cycles(machine, joints, gains, None, 1, seed, environment, laser=True, rise=rise)
        q = records.counts[0] * machine.encoder_resolution
        time = machine.sample_time * np.arange(len(q))
        windows = machine.sample_time * cycle.windows
        parts.append(rests_from_arrays(machine, time, q, *records.laser[0], windows, laser, specimen))
    return joined(parts)
