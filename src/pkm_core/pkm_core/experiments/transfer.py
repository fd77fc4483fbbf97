"""Transfer of the parameters of the basis law to moves without learning: the error of their first cycle."""

from functools import cache

import numpy as np

from pkm_core.control.robust import load_control
from pkm_core.learning import make_law
from pkm_core.learning.training import training_motion
from pkm_core.machines import load_machine
from pkm_core.motion.planning import Motion, Target, default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles

CYCLES = 6  # of the training motion; the last update changes the parameters very little
DAY_AFTER = 100  # added to the seed: the moves follow another power-up, with other noise


def moves_never_learned(machine):
    """Return the default motion, a move of one axis, a move of opposite axes, and two random moves."""
    n = len(machine.joints)
    drawn = np.random.default_rng(5).uniform(-5e-3, 5e-3, (2, n))
    motions = [load_motion(default_motion(machine))]
    for moves in ([[4e-3, *[0.0] * (n - 1)]], [[2.5e-3, -2.5e-3] * (n // 2)], drawn.tolist()):
        targets = tuple(Target(by=dict(zip(machine.joints, move, strict=True))) for move in moves)
        motions.append(Motion(machine=machine.name, targets=targets))
    return motions


@cache
def _prepared(name):
    machine = load_machine(name)
    gains = load_control(machine)
    joints = [to_joints(machine, plan(machine, m)) for m in (training_motion(machine), *moves_never_learned(machine))]
    law = make_law('basis', machine, gains)
    return machine, gains, law, joints[0], [(each, law.with_reference(each)) for each in joints[1:]]


def transfer(name, seed):
    """Return max dynamic error [m] and settling time to 5 um [s] of the worst axis of each move without learning."""
    machine, gains, law, training, moves = _prepared(name)
    learned = run_cycles(machine, training, gains, law, CYCLES, seed).feedforward[-1]
    bound = law.with_reference(training)
    parameters = [bound.parameters(joint, row) for joint, row in zip(machine.joints, learned.T, strict=True)]
    found = []
    for trajectory, there in moves:
        start = [there.feedforward(*each, rested=True) for each in zip(machine.joints, parameters, strict=True)]
        first = run_cycles(machine, trajectory, gains, None, 1, seed + DAY_AFTER, start=np.stack(start, axis=1))
        found.append([first.metric(metric).max() for metric in ('max_dynamic_error', 'settling_time_5um')])
    return np.array(found).T
