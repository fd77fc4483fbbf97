"""
Forces and moments in every joint over a motion: Newton-Euler equations of all free bodies, solved for the reactions.

The planar chains have parallel axes. Their in-plane reactions follow from equilibrium; the vertical ones and the
tilting moments do not, because each loop is carried by more joints than needed. Of all solutions the one with the least
sum of squares is taken, a moment counted as a force at `ARM`: joints of equal stiffness.
Source: thesis ch. 5, (5.2)-(5.21).
"""

from dataclasses import dataclass

import numpy as np

from pkm_core.design.bodies import bodies_and_joints
from pkm_core.machines.dynamics import GRAVITY

_UP = np.array([0.0, 0.0, 1.0])
ARM = 0.02  # [m] distance of the two bearings of a joint, at which a moment is a pair of forces; chosen


@dataclass(frozen=True)
class JointForces:
    """
    Reactions over T samples, acting on the second body of each joint.

    Attributes
    ----------
    joints : list of Joint
        In the order of the last-but-one axis of `reactions`.
    reactions : ndarray, shape (T, joints, 6)
        Three forces [N] and three moments about the joint [N m], along the axes of the joint.
    residual : ndarray, shape (2,)
        Largest of the Newton-Euler equations left over [N, N m].
    thrust_error : float
        Largest difference of the guides' forces from `Machine.inverse_dynamics` [N].
    constraint_power : float
        Largest power of all reactions but the thrusts [W].
    drive_power : float
        Largest power of the thrusts, for comparison [W].
    power_error : float
        Largest difference of that power from the rate of kinetic and potential energy [W].

    """

    joints: list
    reactions: np.ndarray
    residual: np.ndarray
    thrust_error: float
    constraint_power: float
    drive_power: float
    power_error: float


def joint_forces(machine, q, qd, qdd):
    """
    Return the `JointForces` of `machine`, in its drawn lengths, along `q`, `qd`, `qdd` (T, n) [m, m/s, m/s^2].

    Raises
    ------
    PkmError
        If the machine is not a planar or four_dof.
    WorkspaceError
        If a position is out of reach.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> planar = load_machine('planar')
    >>> still = np.zeros((1, 2))
    >>> found = joint_forces(planar, planar.home[np.newaxis], still, still)
    >>> # the weight of 1.632 kg [N]
    >>> round(float(sum(found.reactions[0, i, 2] for i, j in enumerate(found.joints) if j.kind == 'guide')), 4)
    16.0099

    """
    machine = machine.drawing
    q, qd, qdd = (np.asarray(each, dtype=float) for each in (q, qd, qdd))
    bodies, joints = bodies_and_joints(machine, q, qd, qdd)
    A, columns = _matrix(bodies, joints, len(q))
    wanted = np.concatenate(
        [part for body in bodies for part in (body.mass * (body.acceleration + GRAVITY * _UP), body.torque / ARM)],
        axis=1,
    )
    square = A @ np.swapaxes(A, 1, 2)
    found = np.zeros((len(q), A.shape[2]))
    for _ in range(2):  # the second step removes the rounding of the first
        left = wanted - np.einsum('tij,tj->ti', A, found)
        found += np.einsum('tij,ti->tj', A, np.linalg.solve(square, left[..., None])[..., 0])
    left = np.abs(wanted - np.einsum('tij,tj->ti', A, found)).reshape(len(q), -1, 2, 3).max(axis=(0, 1, 3))
    reactions = np.zeros((len(q), len(joints), 6))
    for column, (joint, component) in enumerate(columns):
        reactions[:, joint, component] = found[:, column] * (ARM if component > 2 else 1.0)
    return _with_checks(machine, (q, qd, qdd), bodies, joints, reactions, left * [1.0, ARM])


def _matrix(bodies, joints, samples):
    """Return A (T, 6 bodies, unknowns), moments over `ARM`, and the (joint, component) of each unknown."""
    columns = [(i, component) for i, joint in enumerate(joints) for component in joint.acting]
    A = np.zeros((samples, 6 * len(bodies), len(columns)))
    for column, (i, component) in enumerate(columns):
        joint = joints[i]
        axis = joint.axes[:, component % 3]
        for body, sign in ((joint.first, -1.0), (joint.second, 1.0)):
            if body is None:
                continue
            if component > 2:  # a couple, in units of ARM
                A[:, 6 * body + 3 : 6 * body + 6, column] = sign * axis
                continue
            A[:, 6 * body : 6 * body + 3, column] = sign * axis
            A[:, 6 * body + 3 : 6 * body + 6, column] = sign / ARM * np.cross(joint.place - bodies[body].place, axis)
    return A, columns


def _with_checks(machine, motion, bodies, joints, reactions, residual):
    q, qd, qdd = motion
    thrust = {j.name.split()[1]: reactions[:, i, 0] for i, j in enumerate(joints) if j.kind == 'guide'}
    thrusts = np.stack([thrust[name] for name in machine.joints], axis=1)
    expected = machine.inverse_dynamics(q, qd, qdd)
    drive, gain = np.sum(thrusts * qd, axis=1), np.zeros(len(q))
    for body in bodies:
        force = body.mass * (body.acceleration + GRAVITY * _UP)
        gain += np.sum(force * body.velocity + body.torque * body.spin, axis=1)
    total = sum(_power(joint, reactions[:, i], bodies) for i, joint in enumerate(joints))
    return JointForces(
        joints,
        reactions,
        residual,
        float(np.abs(thrusts - expected).max()),
        float(np.abs(total - drive).max()),
        float(np.abs(drive).max()),
        float(np.abs(drive - gain).max()),
    )


def _power(joint, reaction, bodies):
    """Return the power (T,) [W] of the reaction (T, 6) of one joint on both of its bodies."""
    force, moment = (np.einsum('ti,tij->tj', part, joint.axes) for part in (reaction[:, :3], reaction[:, 3:]))
    power = np.zeros(len(reaction))
    for index, sign in ((joint.first, -1.0), (joint.second, 1.0)):
        if index is not None:
            body = bodies[index]
            velocity = body.velocity + np.cross(body.spin, joint.place - body.place)
            power += sign * np.sum(force * velocity + moment * body.spin, axis=1)
    return power


def loads(joint, reaction):
    """Return the force along the first axis, across it [N] and the moment [N m] (T, 3) of one joint's `reaction`."""
    across = np.linalg.norm(reaction[:, 1:3], axis=1)
    return np.stack([np.abs(reaction[:, 0]), across, np.linalg.norm(reaction[:, 3:], axis=1)], axis=1)


def load_figures(found):
    """Return {joint: peak and root mean square of its `loads`} of `JointForces` [N, N m]."""
    figures = {}
    for i, joint in enumerate(found.joints):
        values = loads(joint, found.reactions[:, i])
        ends = zip(values.max(axis=0), np.sqrt(np.mean(values**2, axis=0)), strict=True)
        figures[joint.name] = {
            f'{name}_{kind}_{unit}': float(value)
            for (name, unit), pair in zip((('along', 'N'), ('across', 'N'), ('moment', 'Nm')), ends, strict=True)
            for kind, value in zip(('peak', 'rms'), pair, strict=True)
        }
    return figures
