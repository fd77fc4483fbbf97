"""The URDF of a machine, read by a reader of its own: one tree with the pose and the kinetic energy of the machine."""

from pathlib import Path

import numpy as np
import pytest

from pkm_core.jet import Jet
from pkm_core.machines import load_machine
from pkm_core.machines.description import ROOT, TOOL, joint_positions
from pkm_core.machines.urdf import urdf
from support.urdf_tree import UrdfTree, numbers

URDF = Path(__file__).parents[3] / 'src' / 'pkm_nodes' / 'urdf'
MACHINES = ('four_dof', 'planar', 'xy_stage')


@pytest.fixture(params=MACHINES)
def machine(request):
    return load_machine(request.param)


@pytest.fixture
def tree(machine):
    return UrdfTree(urdf(machine))


def motions(machine, count):
    """Return `count` pairs of joint positions in the travel [m] and speeds [m/s], the same in every run."""
    random, n = np.random.default_rng(1), len(machine.joints)
    span = machine.limits.upper - machine.limits.lower
    return [(machine.limits.lower + span * random.uniform(size=n), random.normal(size=n)) for _ in range(count)]


def rates_of(machine, q, qd):
    """Return {joint: rate} of motors and passive joints, exact, by Taylor arithmetic."""
    still = np.zeros_like(q)
    passive = machine.passive_angles(Jet.from_derivatives(q, qd, still, still))
    rates = {name: float(angle.derivatives()[1]) for name, angle in passive.items()}
    return rates | dict(zip(machine.joints, qd, strict=True))


def test_urdf_is_one_tree_driven_by_joint_states(machine, tree):
    """Every moving joint is in joint_states or follows a joint that is; `place` fails for a tree in parts."""
    known = joint_positions(machine, machine.home)
    assert tree.root == ROOT
    assert len(tree.joints) == len(tree.robot.findall('joint')) == len(tree.links) - 1
    assert tree.place(known).keys() == tree.links.keys()
    for name, lower, upper in zip(machine.joints, machine.limits.lower, machine.limits.upper, strict=True):
        limit = tree.robot.find(f"joint[@name='{name}']/limit")
        assert (float(limit.get('lower')), float(limit.get('upper'))) == pytest.approx((lower, upper))


def test_tool_of_the_urdf_has_the_pose(machine, tree):
    for q, _ in motions(machine, 20):
        tool = tree.place(joint_positions(machine, q))[TOOL]
        pose = dict(zip(machine.coordinates, machine.forward(q), strict=True))
        assert tool.p == pytest.approx([pose['x'], pose['y'], pose.get('z', 0.0)], abs=1e-12)  # 12 digits of 0.1 m
        assert np.arctan2(tool.R[1, 0], tool.R[0, 0]) == pytest.approx(pose.get('phi', 0.0), abs=1e-11)
        assert tool.R[2, 2] == pytest.approx(1.0)


def test_kinetic_energy_is_that_of_the_mass_matrix(machine, tree):
    """To the 12 digits of the file: the links have the masses, centres and moments of inertia of the configuration."""
    for q, qd in motions(machine, 20):
        energy = tree.kinetic_energy(joint_positions(machine, q), rates_of(machine, q, qd))
        assert energy == pytest.approx(0.5 * qd @ machine.mass_matrix(q) @ qd, rel=1e-10)


def test_slender_rods_differ_by_their_thickness_only():
    """The thesis's thin rods have no inertia along their axis; a URDF with a zero there is refused by simulators."""
    drawn = load_machine('four_dof')
    inertias = drawn.config.inertias.model_copy(update={'rods_about_vertical': 'slender'})
    machine = type(drawn)(drawn.config.model_copy(update={'inertias': inertias}), drawn.name)
    tree = UrdfTree(urdf(machine))
    for q, qd in motions(machine, 20):
        energy = tree.kinetic_energy(joint_positions(machine, q), rates_of(machine, q, qd))
        expected = 0.5 * qd @ machine.mass_matrix(q) @ qd
        assert 0.0 <= energy - expected < 1e-3 * expected


def test_moments_of_inertia_are_those_of_a_body(tree):
    """Positive, and none above the sum of the others: simulators refuse anything else."""
    bodies = tree.robot.findall('link/inertial')
    assert len(bodies) == len(tree.links) - 2, 'all links but the base and the frame of the tool'
    for body in bodies:
        moments = sorted(float(body.find('inertia').get(name)) for name in ('ixx', 'iyy', 'izz'))
        assert 0.0 < moments[0] <= moments[2] <= moments[0] + moments[1]
        assert float(body.find('mass').get('value')) > 0.0


def test_collision_shapes_are_the_visible_boxes(tree):
    for link in tree.links.values():
        shapes = {
            kind: [
                [*numbers(shape.find('origin').get('xyz')), *numbers(shape.find('geometry/box').get('size'))]
                for shape in link.findall(kind)
            ]
            for kind in ('visual', 'collision')
        }
        assert shapes['visual'] == shapes['collision']


def test_urdf_file_is_that_of_the_configuration(machine):
    file = URDF / f'{machine.name}.urdf'
    assert file.read_text(encoding='utf-8') == urdf(machine), (
        f'{file} is old; renew it: python -c "from pkm_core.machines.urdf import urdf; '
        f"from pkm_core.machines import load_machine; print(urdf(load_machine('{machine.name}')), end='')\" > {file}"
    )
