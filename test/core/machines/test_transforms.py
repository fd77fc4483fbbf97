"""The transforms of all links at once are those of the description, link by link."""

import numpy as np
import pytest

from pkm_core.machines import load_machine
from pkm_core.machines.description import TOOL, joint_positions, links
from pkm_core.machines.transforms import LinkTransforms, transform


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


def test_transforms_need_every_passive_joint():
    machine = load_machine('planar')
    with pytest.raises(KeyError, match='th2'):
        LinkTransforms(machine).at(dict(zip(machine.joints, machine.home, strict=True)))
