"""
The simulated machine by its truth: where it stands, and its errors of lengths and marks.

Experiments judge a calibration with it; nothing else may.
"""

import numpy as np

from pkm_core.control.controllers import make_controller
from pkm_core.control.robust import load_control
from pkm_core.design.calibration_motion import calibration_motion
from pkm_core.design.specimen import error_names
from pkm_core.errors import PkmError
from pkm_core.machines.built import drawn_length
from pkm_core.motion.trajectory import to_joints
from pkm_core.plant.plant import Plant

EVERY = 10  # [ticks] of the truth that are averaged; chosen: 20 of each rest


def true_errors(machine, seed, environment='nominal'):
    """
    Return {name: error} [m, rad, m/m] of the specimen, names as in design/specimen.py.

    They are links, offsets and marks; guides, scales and laser axes if the environment has them.
    """
    error_names(machine)  # refuses machines without links
    assembly, geometry = Plant(machine.drawing, seed, environment).truth.assembly, machine.config.geometry
    links = {name: length - drawn_length(geometry, name) for name, length in assembly.lengths.items()}
    offsets = {name: getattr(assembly.offsets, name) - getattr(geometry, name) for name in ('dx', 'dy', 'dz')
               if hasattr(geometry, name)}  # fmt: skip
    marks = dict(zip(machine.joints, assembly.encoder_offset.tolist(), strict=True))
    return links | offsets | marks | assembly.geometry_errors(machine.joints)


def true_poses(machine, q, seed, environment='nominal', rise=None):
    """
    Return the poses (N, m) [m, rad] of the specimen whose encoders, without error, read `q` (N, n) [m].

    `rise` are the temperatures of the plant, see `Plant`.
    """
    truth = Plant(machine.drawing, seed, environment, rise).truth
    return truth.assembly.end_point(q - truth.assembly.encoder_offset, np.tile(truth.belts, (len(q), 1)))


def true_rests(machine, poses, seed, environment='nominal', gains=None):
    """
    Return the rests (N, m) [m, rad] of the simulated machine when `machine` sends it to `poses` (N, m).

    The machine runs the motion of a calibration; a rest is the mean pose over the last part of it. `PkmError` if the
    machine stops with a fault, `WorkspaceError` if a pose is out of reach.
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
