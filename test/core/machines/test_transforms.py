"""The transforms of all links at once are those of the description, link by link."""

import numpy as np
import pytest

from pkm_core.machines import load_machine
from pkm_core.machines.description import TOOL, frames, joint_positions, links, moved, product
from pkm_core.machines.real_geometry import FourDofRealGeometry, PlanarRealGeometry
from pkm_core.machines.transforms import SIZE, LinkTransforms, transform


@pytest.mark.parametrize('name', ['four_dof', 'planar', 'xy_stage'])
def test_transforms_are_those_of_the_description(name):
    machine = load_machine(name)
    transforms = LinkTransforms(machine)
    assert {*transforms.moving, *transforms.fixed} == set(links(machine))
    assert [link.name for link in transforms.fixed] == [TOOL]
    for q in np.random.default_rng(1).uniform(machine.limits.lower, machine.limits.upper, (20, len(machine.joints))):
        positions = joint_positions(machine, q)
        expected = np.concatenate([transform(link, positions) for link in transforms.moving])
        # a sum of two products of numbers up to 1
        np.testing.assert_allclose(transforms.at(positions), expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize('name', ['four_dof', 'planar'])
def test_tool_of_a_machine_with_real_guides_has_the_pose(name):
    """The guides are not in the tree of links, so the last transform moves."""
    drawn = load_machine(name)
    built = drawn.Built.as_drawn(drawn.config.geometry)
    kind = {'four_dof': FourDofRealGeometry, 'planar': PlanarRealGeometry}[name]
    built = built.model_copy(update={'geometry': kind(x_side_2=5e-6, scale_d1=8e-5)})
    machine = type(drawn)(drawn.config.model_copy(update={'built': built}), drawn.name)
    transforms = LinkTransforms(machine)
    assert [link.name for link in transforms.moving][-1] == TOOL
    assert not transforms.fixed
    for q in np.random.default_rng(1).uniform(machine.limits.lower, machine.limits.upper, (5, len(machine.joints))):
        positions = joint_positions(machine, q)
        *origin, x, y, z, w = transforms.at(positions)[-SIZE:]
        turn, start = frames(links(machine), positions)[transforms.moving[-1].parent]
        pose = dict(zip(machine.coordinates, machine.forward(q), strict=True))
        expected = [pose['x'], pose['y'], pose.get('z', 0.0)]
        np.testing.assert_allclose(moved(turn, start, origin), expected, rtol=0, atol=1e-14)
        half = 0.5 * pose.get('phi', 0.0)
        assert abs(np.dot(product(turn, (w, x, y, z)), [np.cos(half), 0, 0, np.sin(half)])) == pytest.approx(1.0)
        assert np.abs(np.array(expected) - frames(links(machine), positions)[TOOL][1]).max() > 1e-7


def test_transforms_need_every_passive_joint():
    machine = load_machine('planar')
    with pytest.raises(KeyError, match='th2'):
        LinkTransforms(machine).at(dict(zip(machine.joints, machine.home, strict=True)))
