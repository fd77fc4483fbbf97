"""The description of a machine: its tree agrees with the kinematics of the drawing and of a built machine."""

import numpy as np
import pytest

from pkm_core.design.calibration import built_machine
from pkm_core.machines import load_machine
from pkm_core.machines.description import TOOL, frames, joint_positions, links, moved

MACHINES = ('four_dof', 'planar', 'xy_stage')
# [m] a dozen rotations and a few square roots of numbers of size 0.1
EXACT = 1e-14


# [m] differences of a built machine from its drawing, a different one for each length and mark
VARIED = ('l2', 'l4', 'l6', 'l8', 'k10', 'k12', 'dx', 'dy', 'dz', 'd1', 'd5')
OFF = {name: 1e-5 * (5 + i) for i, name in enumerate(VARIED)}


@pytest.fixture(params=[*MACHINES, 'four_dof built', 'planar built'])
def machine(request):
    name, *built = request.param.split()
    machine = load_machine(name)
    return built_machine(machine, OFF) if built else machine


def positions_within(machine, count):
    """Return `count` joint positions in the travel, the same in every run."""
    span = machine.limits.upper - machine.limits.lower
    return machine.limits.lower + span * np.random.default_rng(1).uniform(size=(count, len(machine.joints)))


def test_tool_frame_is_the_forward_kinematics(machine):
    for q in positions_within(machine, 20):
        turn, origin = frames(links(machine), joint_positions(machine, q))[TOOL]
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
