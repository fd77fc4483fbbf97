"""Tables 4.1-4.5 of the thesis recomputed: every objective with either error matrix, and the error statistics."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pkm_core.design.error_matrix import Geometry, check_reach, geometry_of, linkage
from pkm_core.design.objectives import VARIANTS, Statistics, error_statistics, objectives
from pkm_core.design.operational_workspace import OperationalWorkspace
from pkm_core.design.optimisation import Optimum, optimum
from pkm_core.design.specimen import LINKS, sensitivities
from pkm_core.design.workspace import sample_joints

NAMES = ('f', 'f1', 'f2')


class Objective(NamedTuple):
    """One objective with one error matrix on one grid."""

    initial: float  # at the initial design
    optimum: Optimum


@dataclass(frozen=True)
class ToleranceStudy:
    """
    Chapter 4 on one operational workspace.

    Attributes
    ----------
    objectives : dict
        `Objective` by (name, variant, grid).
    designs : dict
        `Geometry` by title: the initial one and the optima with the thesis's matrix. As in the thesis, f and f1 are
        taken at the middle angle and f2 over all.
    statistics : dict
        {coordinate: Statistics} by (title, variant), over all angles.

    """

    objectives: dict[tuple[str, str, str], Objective]
    designs: dict[str, Geometry]
    statistics: dict[tuple[str, str], dict[str, Statistics]]


def study_tolerance(workspace: OperationalWorkspace, arm=1e-3, on_step=lambda name: None) -> ToleranceStudy:
    """Return the `ToleranceStudy` of `workspace`, angles on an `arm` [m]; `on_step` gets the name of each step."""
    grids = {'middle': workspace.workspace.poses_at_middle_angle(), 'all': workspace.workspace.poses()}
    initial = workspace.geometry(workspace.initial.l, workspace.initial.k)
    check_reach(initial, grids['all'])
    found = {}
    for variant in VARIANTS:
        for grid, poses in grids.items():
            start = objectives(initial, poses, variant, arm)
            for name in NAMES:
                on_step(f'optimum of {name}, {variant} error matrix, {len(poses)} poses')
                best = optimum(workspace, poses, name, variant, arm)
                found[name, variant, grid] = Objective(float(getattr(start, name)), best)
    designs = {'Table 4.2, initial': initial}
    for number, name, grid in ((3, 'f', 'middle'), (4, 'f1', 'middle'), (5, 'f2', 'all')):
        best = found[name, 'thesis', grid].optimum
        designs[f'Table 4.{number}, optimum of {name}'] = workspace.geometry(best.l2, best.k10)
    statistics = {
        (title, variant): error_statistics(design, grids['all'], variant)
        for title, design in designs.items()
        for variant in VARIANTS
    }
    return ToleranceStudy(found, designs, statistics)


def against_differences(machine, seed, samples=1000):
    """
    Return {variant: (4,)}, the difference of the rows of an error matrix from finite differences of the mechanism.

    It is the largest over `samples` positions of a four_dof; rows x, y, z [m/m] and phi [rad/m].

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> worst = against_differences(load_machine('four_dof'), seed=1)
    >>> bool(worst['true'][2] < 1e-8), bool(worst['thesis'][2] > 0.1)
    (True, True)

    """
    q = sample_joints(machine, samples, seed)
    at = linkage(geometry_of(machine), machine.forward(q))
    links = sensitivities(machine, q, LINKS['four_dof'])
    return {variant: np.abs(matrix(at) - links).max(axis=(0, 2)) for variant, matrix in VARIANTS.items()}


class DesignOnWorkspace(NamedTuple):
    """Objectives and joint range of one machine's link lengths on an operational workspace."""

    values: dict  # {variant: {objective: value}}, all angles
    joints_needed: list  # of (name, lowest, highest needed, lower, upper limit) [m]


def design_on_workspace(machine, workspace, arm=1e-3):
    """
    Return the `DesignOnWorkspace` of a four_dof's link lengths.

    Raises
    ------
    WorkspaceError
        If the links are too short or too long to reach all poses. The travel is reported, not checked: a design may
        shift it.

    """
    poses, drawn = workspace.workspace.poses(), geometry_of(machine)
    geometry = workspace.geometry(drawn.l2, drawn.k10)
    check_reach(geometry, poses)
    joints = linkage(geometry, poses).joints()
    values = {}
    for variant in VARIANTS:
        found = objectives(geometry, poses, variant, arm)
        values[variant] = {name: float(getattr(found, name)) for name in (*NAMES, 'size')}
    needed = zip(
        machine.joints,
        joints.min(axis=0),
        joints.max(axis=0),
        machine.limits.lower,
        machine.limits.upper,
        strict=True,
    )
    return DesignOnWorkspace(values, [(name, *map(float, rest)) for name, *rest in needed])
