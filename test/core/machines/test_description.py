"""The description of a machine: its tree agrees with the kinematics, and the URDF files are generated from it."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from pkm_core.machines import load_machine
from pkm_core.machines.description import ROOT, frames, joint_positions, links, moved, urdf

URDF = Path(__file__).parents[3] / 'src' / 'pkm_nodes' / 'urdf'
MACHINES = ('four_dof', 'planar', 'xy_stage')
# [m] a dozen rotations and a few square roots of numbers of size 0.1
EXACT = 1e-14


@pytest.fixture(params=MACHINES)
def machine(request):
    return load_machine(request.param)


def positions_within(machine, count):
    """Return `count` joint positions in the travel, the same in every run."""
    span = machine.limits.upper - machine.limits.lower
    return machine.limits.lower + span * np.random.default_rng(1).uniform(size=(count, len(machine.joints)))


def test_tool_frame_is_the_forward_kinematics(machine):
    for q in positions_within(machine, 20):
        turn, origin = frames(links(machine), joint_positions(machine, q))['tool']
        pose = dict(zip(machine.coordinates, machine.forward(q), strict=True))
        assert origin == pytest.approx([pose['x'], pose['y'], pose.get('z', 0.0)], abs=EXACT)
        phi = pose.get('phi', 0.0)
        for point, there in (
            ((1.0, 0.0, 0.0), (np.cos(phi), np.sin(phi), 0.0)),
            ((0.0, 1.0, 0.0), (-np.sin(phi), np.cos(phi), 0.0)),
        ):
            assert moved(turn, (0.0, 0.0, 0.0), point) == pytest.approx(there, abs=EXACT)


@pytest.mark.parametrize(
    ('name', 'bar', 'length', 'meets'),
    [
        ('four_dof', 'link_4', 'l2', 'platform_p'),
        ('four_dof', 'link_6', 'l2', 'platform_q'),
        ('four_dof', 'link_12', 'k10', 'end_effector'),
        ('planar', 'link_4', 'l2', 'platform_p'),
    ],
)
def test_cut_loops_are_closed(name, bar, length, meets):
    machine = load_machine(name)
    for q in positions_within(machine, 20):
        found = frames(links(machine), joint_positions(machine, q))
        end = moved(*found[bar], (getattr(machine.config.geometry, length), 0.0, 0.0))
        assert end == pytest.approx(found[meets][1], abs=EXACT)


def test_urdf_is_one_tree_driven_by_joint_states(machine):
    robot = ElementTree.fromstring(urdf(machine).encode())
    joints = robot.findall('joint')
    children = [joint.find('child').get('link') for joint in joints]
    assert sorted([ROOT, *children]) == sorted(link.get('name') for link in robot.findall('link'))
    assert len(set(children)) == len(children)
    known = joint_positions(machine, machine.home)
    for joint in joints:
        mimic = joint.find('mimic')
        assert joint.get('type') == 'fixed' or (mimic.get('joint') if mimic is not None else joint.get('name')) in known
    for name, lower, upper in zip(machine.joints, machine.limits.lower, machine.limits.upper, strict=True):
        limit = robot.find(f"joint[@name='{name}']/limit")
        assert (float(limit.get('lower')), float(limit.get('upper'))) == pytest.approx((lower, upper))


def test_urdf_file_is_that_of_the_configuration(machine):
    file = URDF / f'{machine.name}.urdf'
    assert file.read_text(encoding='utf-8') == urdf(machine), (
        f'{file} is old; renew it: python -c "from pkm_core.machines.description import urdf; '
        f"from pkm_core.machines import load_machine; print(urdf(load_machine('{machine.name}')), end='')\" > {file}"
    )
