"""
The rigid 4-DOF machine integrated in three ways under the same forces: reference, the plant's rule, MuJoCo.

The forces are those of case (i)(a), (5.24), held over each tick as by an amplifier, for one period of 70 ms. The model
of MuJoCo is the mechanism link by link in Cartesian space, from the same machine file. Its loops are closed by equality
constraints; belts are ideal.
"""

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from pkm_core.experiments.open_loop import CASES
from pkm_core.plant.tick import rigid_terms, solve

FOUR_DOF = 2  # in plant_arrays.MECHANISMS
TICKS = 140  # 70 ms


def forces(machine):
    """Return the forces (TICKS, 4) [N] of the ticks."""
    return CASES['i_a'].force(machine.sample_time * np.arange(TICKS))


def reference(machine, force):
    """Return the joint positions (T, 4) [m] at the end of every tick, to 1e-13 m."""
    p, state, path = machine.dynamic_parameters(), np.append(machine.home, np.zeros(4)), []
    M, C, G = np.empty((4, 4)), np.empty(4), np.empty(4)

    def rate(_, state, held):
        machine.terms(state[:4], state[4:], p, M, C, G)
        return np.append(state[4:], np.linalg.solve(M, held - C - G))

    for held in force:
        solution = solve_ivp(
            rate, (0.0, machine.sample_time), state, 'DOP853', args=(held,), rtol=1e-12, atol=1e-14, first_step=1e-4
        )
        state = solution.y[:, -1]
        path.append(state[:4])
    return np.array(path)


@njit(cache=True, error_model='numpy')
def _step_rigid(q, qd, force, p, tick, substeps, path):
    """Apply the rule of plant.tick to the rigid machine: terms at the middle of a substep, acceleration held."""
    n = q.size
    M, C, G, qdd = np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n)
    middle, speed, right = np.zeros(n), np.zeros(n), np.zeros(n)
    h = tick / substeps
    for k in range(force.shape[0]):
        for _ in range(substeps):
            for i in range(n):
                middle[i] = q[i] + 0.5 * h * qd[i]
                speed[i] = qd[i] + 0.5 * h * qdd[i]
            rigid_terms(FOUR_DOF, middle, speed, p, M, C, G)
            for i in range(n):
                right[i] = force[k, i] - C[i] - G[i]
            solve(M, right)
            for i in range(n):
                qdd[i] = right[i]
                q[i] += h * (qd[i] + 0.5 * h * right[i])
                qd[i] += h * right[i]
        path[k] = q


def step_rigid(machine, force, substeps):
    """Return the joint positions (T, 4) [m] at the end of every tick by the plant's rule with `substeps` per tick."""
    path = np.empty_like(force)
    _step_rigid(
        machine.home.copy(), np.zeros(4), force, machine.dynamic_parameters(), machine.sample_time, substeps, path
    )
    return path


def _body(name, mass, centre, inertia, content, position=(0.0, 0.0, 0.0)):
    """Return a body with equal inertia about every axis, sufficient for the rotations of 5.1."""
    at, com = (' '.join(f'{value:.17g}' for value in vector) for vector in (position, centre))
    return (
        f'<body name="{name}" pos="{at}"><inertial mass="{mass:.17g}" pos="{com}" '
        f'diaginertia="{inertia:.17g} {inertia:.17g} {inertia:.17g}"/>{content}</body>'
    )


def _slide(name, axis):
    return f'<joint name="{name}" type="slide" axis="{axis}"/>'


def _hinge(name, axis='0 0 1'):
    return f'<joint name="{name}" type="hinge" axis="{axis}"/>'


def _site(name, x=0.0):
    return f'<site name="{name}" pos="{x:.17g} 0 0"/>'


def mjcf(machine, step, integrator):
    """
    Return the MJCF of `machine` for steps of `step` [s] with an integrator of MuJoCo ('Euler', 'RK4', ...).

    Platforms P and Q have sliding joints only, so they cannot rotate. The equality of two angles keeps the end-effector
    level. Links 9 and 11 rotate with the end-effector. Constraints are as stiff as MuJoCo allows.
    """
    g, m, inertias = machine.config.geometry, machine.config.masses, machine.config.inertias
    slider_inertia = 1e-3  # a slider does not rotate
    bodies = []
    for number, axis in ((1, '1 0 0'), (3, '1 0 0'), (5, '0 1 0'), (7, '0 1 0')):
        link = f'{number + 1}'
        mass, centre, inertia = (getattr(part, kind + link) for part, kind in ((m, 'm'), (g, 'r'), (inertias, 'I')))
        arm = _body(f'link{link}', mass, (centre, 0.0, 0.0), inertia, _hinge(f'th{link}') + _site(f'tip{link}', g.l2))
        bodies.append(
            _body(
                f'slider{number}',
                getattr(m, f'm{number}'),
                (0.0, 0.0, 0.0),
                slider_inertia,
                _slide(f'd{number}', axis) + arm,
            )
        )
    effector = _body(
        'end_effector',
        m.mef,
        (0.0, 0.0, g.dz),
        inertias.Ief,
        _hinge('level', '0 1 0') + _site('apex'),
        (-g.k10, 0.0, 0.0),
    )
    link10 = _body('link10', m.m10, (-g.r10, 0.0, 0.0), inertias.I10, _hinge('theta10', '0 1 0') + effector)
    link12 = _body(
        'link12', m.m12, (g.r12, 0.0, 0.0), inertias.I12, _hinge('theta12', '0 -1 0') + _site('tip12', g.k10)
    )
    link9 = _body('link9', m.m9, (0.0, 0.0, 0.0), inertias.I9, _hinge('phi') + link10, (0.0, g.dy, 0.0))
    link11 = _body('link11', m.m11, (0.0, 0.0, 0.0), inertias.I11, _hinge('phi11') + link12, (g.dx, 0.0, 0.0))
    for name, mass, carried in (('P', m.mp, link9), ('Q', m.mq, link11)):
        joints = _slide(f'{name}x', '1 0 0') + _slide(f'{name}y', '0 1 0')
        bodies.append(_body(name, mass, (0.0, 0.0, 0.0), slider_inertia, joints + _site(name) + carried))
    loops = (('tip2', 'P'), ('tip4', 'P'), ('tip6', 'Q'), ('tip8', 'Q'), ('tip12', 'apex'))
    stiff = f'solref="{2.0 * step:.17g} 1" solimp="0.9999 0.9999 0.001 0.5 2"'
    equalities = ''.join(f'<connect site1="{one}" site2="{other}" {stiff}/>' for one, other in loops)
    equalities += f'<joint joint1="phi11" joint2="phi" polycoef="0 1 0 0 0" {stiff}/>'
    equalities += f'<joint joint1="level" joint2="theta10" polycoef="0 -1 0 0 0" {stiff}/>'
    motors = ''.join(f'<motor joint="{joint}"/>' for joint in machine.joints)
    return (
        f'<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option timestep="{step:.17g}" integrator="{integrator}" solver="Newton" jacobian="dense" tolerance="1e-12" '
        f'gravity="0 0 -9.81"><flag contact="disable"/></option>'
        f'<worldbody>{"".join(bodies)}</worldbody><equality>{equalities}</equality><actuator>{motors}</actuator></mujoco>'
    )


class MujocoChain:
    """The same machine in MuJoCo, with `substeps` steps per tick."""

    def __init__(self, machine, integrator, substeps):
        import mujoco

        self._mujoco, self._substeps = mujoco, substeps
        self._model = mujoco.MjModel.from_xml_string(mjcf(machine, machine.sample_time / substeps, integrator))
        self._data = mujoco.MjData(self._model)
        q = machine.home
        angles = machine.passive_angles(q)
        g = machine.config.geometry
        places = dict(zip(machine.joints, q, strict=True))
        # th6 and th8 count from +X in both models
        places |= {name: angles[name] for name in ('th2', 'th4', 'th6', 'th8', 'theta10', 'theta12', 'phi')}
        places |= {'phi11': angles['phi'], 'level': -angles['theta10']}
        places |= {'Px': 0.5 * (q[0] + q[1]), 'Py': g.l2 * np.sin(angles['th2'])}
        places |= {'Qx': g.l2 * np.cos(angles['th8']), 'Qy': 0.5 * (q[2] + q[3])}
        for name, value in places.items():
            self._data.joint(name).qpos[0] = value
        self._start = self._data.qpos.copy()
        self._joints = [self._model.joint(joint).qposadr[0] for joint in machine.joints]

    def step(self, force):
        """Return the joint positions (T, 4) [m] at the end of every tick under `force` (T, 4) [N], from rest."""
        model, data, path = self._model, self._data, np.empty_like(force)
        self._mujoco.mj_resetData(model, data)
        data.qpos[:] = self._start
        for k, held in enumerate(force):
            data.ctrl[:] = held
            self._mujoco.mj_step(model, data, self._substeps)
            path[k] = data.qpos[self._joints]
        return path
