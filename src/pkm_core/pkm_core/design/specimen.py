"""
A built machine that deviates from its drawing, and the sensitivity of its end point to each deviation.

Errors have names. `l2` ... `k12`: excess length of a link [m]. `dx`, `dy`, `dz`: excess of an offset [m]. `d1` ...
`d7`: reading of an encoder minus position of its slider [m]. `psi_p`, `psi_q`: rotation of the platform at P, at Q, due
to the elasticity of its belt [rad]. Beyond these, errors of guides and scales have the names of
machines/real_geometry.py.
"""

from types import SimpleNamespace

import numpy as np

from pkm_core.design.geometry import geometry_names
from pkm_core.errors import PkmError
from pkm_core.machines.assembly import Assembly
from pkm_core.machines.built import drawn_length
from pkm_core.machines.real_geometry import end_point as real_end_point
from pkm_core.machines.real_geometry import guide_ends

LINKS = {'four_dof': ('l2', 'l4', 'l6', 'l8', 'k10', 'k12'), 'planar': ('l2', 'l4')}
OFFSETS = {'four_dof': ('dx', 'dy', 'dz'), 'planar': ('dy',)}
BELTS = {'four_dof': ('psi_p', 'psi_q'), 'planar': ('psi_p',)}
_STEP = 1e-6  # [m, rad] of the central differences; their relative error is 1e-9


def error_names(machine):
    """Return the names of all errors of lengths, marks and belts of a specimen of `machine`."""
    mechanism = machine.config.mechanism
    if mechanism not in LINKS:
        raise PkmError(f'{machine.name}: a {mechanism} has no links with tolerances; known: {sorted(LINKS)}')
    return (*LINKS[mechanism], *OFFSETS[mechanism], *machine.joints, *BELTS[mechanism])


def end_point(machine, q, errors):
    """
    Return the pose (..., m) of a specimen of `machine` at the encoder readings `q` (..., n) [m].

    `errors` is {name: number or array that broadcasts with (...,)}; missing errors are zero. Axes of a laser
    (`laser_xy` ...) have no effect.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> planar = load_machine('planar')
    >>> moved = end_point(planar, planar.home, {'l2': 1e-6}) - planar.forward(planar.home)
    >>> (1e6 * moved).round(3)  # l / gap and l / 2 Y of (4.9)
    array([1.167, 0.553])

    """
    lengths_and_marks = error_names(machine)
    known = (*lengths_and_marks, *geometry_names(machine))
    unknown = sorted(set(errors) - set(known))
    if unknown:
        raise PkmError(f'{machine.name}: unknown errors {unknown}; known: {list(known)}')
    mechanism, geometry = machine.config.mechanism, machine.config.geometry
    offsets = {name: getattr(geometry, name) + errors.get(name, 0.0) for name in OFFSETS[mechanism]}
    lengths = {link: drawn_length(geometry, link) + errors.get(link, 0.0) for link in LINKS[mechanism]}
    q = np.asarray(q, dtype=float)
    sliders = [q[..., i] - errors.get(joint, 0.0) for i, joint in enumerate(machine.joints)]
    turns = [errors.get(name, 0.0) for name in ('psi_p', 'psi_q')]  # a planar machine has no platform at Q
    shape = np.broadcast_shapes(*(np.shape(part) for part in (*sliders, *errors.values())))
    at, belts = (np.stack([np.broadcast_to(part, shape) for part in parts], axis=-1) for parts in (sliders, turns))
    beyond = {name: error for name, error in errors.items() if name not in lengths_and_marks}
    if beyond:
        named = {**offsets, **lengths, **beyond, 'psi_p': turns[0], 'psi_q': turns[1]}
        return real_end_point(mechanism, at, named, guide_ends(machine.limits))
    specimen = Assembly(
        mechanism,
        offsets=SimpleNamespace(**offsets),
        lengths=lengths,
        encoder_offset=np.zeros(len(machine.joints)),  # subtracted above, because it may differ between poses
        payload=0.0,
    )
    return specimen.end_point(at, belts)


def sensitivities(machine, q, names=None, errors=None):
    """
    Return d end_point / d error (..., m, len(names)) at `q` (..., n), by central differences.

    `names` defaults to all of `error_names`, `errors` to the drawing (no errors). Units: m/m, rad/m, m/rad, rad/rad.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> planar = load_machine('planar')
    >>> sensitivities(planar, planar.home, ('l2', 'l4', 'dy')).round(4)
    array([[ 1.1667, -1.1667,  0.    ],
           [ 0.5534,  0.5534,  1.    ]])

    """
    names = error_names(machine) if names is None else names
    at = errors or {}
    ahead, behind = (
        [end_point(machine, q, {**at, name: at.get(name, 0.0) + step}) for name in names] for step in (_STEP, -_STEP)
    )
    return (np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)) / (2.0 * _STEP)
