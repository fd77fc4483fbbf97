"""True rests of the simulated machine: the judge of a calibration; reads the truth of the plant."""

import numpy as np

from pkm_core.control.controllers import make_controller
from pkm_core.control.robust import load_control
from pkm_core.design.calibration_motion import calibration_motion
from pkm_core.errors import PkmError
from pkm_core.motion.trajectory import to_joints
from pkm_core.plant.plant import Plant

EVERY = 10  # [ticks] of the truth that are averaged; chosen: 20 of each rest


def true_rests(machine, poses, seed, environment='nominal', gains=None):
    """
    Return where the simulated machine rests when `machine` sends it to `poses`, by the truth of the plant.

    The machine runs the motion of a calibration. An experiment judges a calibration with it; nothing else may.

    Returns
    -------
    reached : ndarray, shape (N, m)
        Mean pose over the average of each rest [m, rad].

    """
    gains = load_control(machine) if gains is None else gains
    reached = []
    for cycle in calibration_motion(machine, poses):
        joints = to_joints(machine, cycle.trajectory)
        plant, controller = Plant(machine, seed, environment), make_controller(machine, gains)
        controller.load(joints, np.zeros(joints.position.shape))
        plant.start_cycle(1)
        seen = {index for window in cycle.windows for index in range(window[0], window[1], EVERY)}
        sliders, belts = [], []
        for index in range(len(joints)):
            if index in seen:
                truth = plant.truth
                sliders.append(truth.q)
                belts.append(truth.belts)
            volts, _ = controller.update(index, plant.counts * machine.encoder_resolution)
            plant.tick(volts)
            if plant.fault:
                raise PkmError(f'sample {index}: {plant.fault}')
        pose = plant.truth.assembly.end_point(np.array(sliders), np.array(belts))
        reached.append(pose.reshape(len(cycle.windows), -1, pose.shape[1]).mean(axis=1))
    return np.concatenate(reached)
