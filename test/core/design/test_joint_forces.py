"""Joint forces against the equations of motion, statics and energy."""

import numpy as np
import pytest

from pkm_core.config import Configuration
from pkm_core.design.bodies import bodies_and_joints
from pkm_core.design.joint_forces import joint_forces
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.machines.dynamics import GRAVITY


def motion(machine, samples=40, seed=1):
    """Return q, qd, qdd (samples, n) at random within the travel; samples need not belong to one motion."""
    generator, n = np.random.default_rng(seed), len(machine.joints)
    lower, upper = machine.limits.lower, machine.limits.upper
    q = lower + (upper - lower) * generator.random((samples, n))
    return q, generator.normal(0.0, 0.3, (samples, n)), generator.normal(0.0, 10.0, (samples, n))


@pytest.fixture
def slender(tmp_path):
    text = (Configuration.of_environment().folder / 'machines' / 'four_dof.yaml').read_text()
    text = text.replace('rods_about_vertical: isotropic', 'rods_about_vertical: slender')
    (tmp_path / 'four_dof.yaml').write_text(text)
    return tmp_path / 'four_dof.yaml'


@pytest.mark.parametrize('name', ['planar', 'four_dof', 'slender'])
def test_bodies_are_in_equilibrium_and_thrusts_are_f_of_5_1(name, request):
    """The free bodies are an independent formulation of M, C, G: thrusts agree with `inverse_dynamics`."""
    machine = load_machine(request.getfixturevalue('slender') if name == 'slender' else name)
    found = joint_forces(machine, *motion(machine))
    assert (found.residual < 1e-9).all()
    assert found.thrust_error < 1e-9


@pytest.mark.parametrize('name', ['planar', 'four_dof'])
def test_reactions_do_no_work_and_thrusts_give_the_energy(name):
    machine = load_machine(name)
    found = joint_forces(machine, *motion(machine))
    assert found.drive_power > 1.0
    assert found.constraint_power < 1e-9
    assert found.power_error < 1e-9


def test_guides_carry_the_whole_weight():
    machine = load_machine('four_dof')
    q, _, _ = motion(machine)
    found = joint_forces(machine, q, 0.0 * q, 0.0 * q)
    weight = GRAVITY * sum(dict(machine.config.masses).values())
    carried = sum(found.reactions[:, i, 2] for i, joint in enumerate(found.joints) if joint.kind == 'guide')
    np.testing.assert_allclose(carried, weight, rtol=1e-12)


def test_forces_in_the_plane_are_those_of_the_two_links():
    """A planar machine at rest whose platform alone is pushed: statics of two bars, by hand."""
    machine = load_machine('planar')
    light = machine.config.masses.model_copy(update={'m2': 1e-12, 'm4': 1e-12, 'mp': 2.0})
    inertias = machine.config.inertias.model_copy(update={'I2': 1e-18, 'I4': 1e-18})
    config = machine.config.model_copy(update={'masses': light, 'inertias': inertias})
    machine = type(machine)(config, machine.name, machine.configuration)
    q = machine.home[np.newaxis]
    # both sliders accelerate by 3 m/s^2: P too, and each link takes half of 2 kg * 3 m/s^2 along X
    found = joint_forces(machine, q, 0.0 * q, 0.0 * q + 3.0)
    named = {joint.name: reaction for joint, reaction in zip(found.joints, found.reactions[0], strict=True)}
    pushed = named['d1 - link 2'][1:3]  # along X and Y; a weightless link carries force along itself
    slope = np.sqrt(0.07**2 - 0.03**2) / 0.03
    np.testing.assert_allclose(pushed, [3.0, 3.0 * slope], rtol=1e-9)
    np.testing.assert_allclose(named['belt p'][3], -2.0 * 3.0 * 0.01, rtol=1e-9)  # holds the mass at dy over the joint


def test_points_of_a_joint_have_one_velocity_in_both_bodies():
    machine = load_machine('four_dof')
    bodies, joints = bodies_and_joints(machine, *motion(machine))
    for joint in joints:
        if joint.kind != 'revolute':
            continue
        first, second = (
            body.velocity + np.cross(body.spin, joint.place - body.place)
            for body in (bodies[joint.first], bodies[joint.second])
        )
        np.testing.assert_allclose(first, second, atol=1e-13)


def test_calibrated_lengths_do_not_change_the_forces():
    machine = load_machine('planar')
    built = type(machine).Built.as_drawn(machine.config.geometry).model_copy(update={'l2': 0.0701})
    other = type(machine)(machine.config.model_copy(update={'built': built}), machine.name, machine.configuration)
    first, second = (joint_forces(each, *motion(machine)) for each in (machine, other))
    np.testing.assert_array_equal(first.reactions, second.reactions)


def test_machine_without_links_has_no_joint_forces():
    stage = load_machine('xy_stage')
    with pytest.raises(PkmError, match='xy_stage has no joints with modelled forces; expected planar or four_dof'):
        joint_forces(stage, *motion(stage))
