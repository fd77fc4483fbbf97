"""Modules and layouts of chapter 2 as machines without dynamics: kinematics, and what is refused."""

import numpy as np
import pytest

from pkm_core.config import Configuration
from pkm_core.design.layouts import pairs_of
from pkm_core.design.specimen import LINKS, sensitivities
from pkm_core.design.workspace import sample_joints
from pkm_core.errors import ConfigError, WorkspaceError
from pkm_core.jet import Jet
from pkm_core.machines import load_machine
from pkm_core.machines.kinematic import CORE_ORDER
from pkm_core.motion.planning import default_motion

NAMES = ('h_linkage', 'v_linkage', 'parallel_layout')


@pytest.mark.parametrize('name', NAMES)
def test_inverse_undoes_forward_over_the_travel(name):
    machine = load_machine(name)
    q = sample_joints(machine, 2000, 1)
    np.testing.assert_allclose(machine.inverse(machine.forward(q)), q, atol=1e-14)
    assert (machine.singularity_margin(q) > 0.0).all()


@pytest.mark.parametrize('name', NAMES)
def test_jacobian_is_the_rate_of_a_moving_pose(name):
    """The pose of a Jet is differentiated by the rules of Taylor series, not by the equations of `rates`."""
    machine = load_machine(name)
    q = sample_joints(machine, 20, 1)
    n = q.shape[1]
    for i in range(n):
        moving = Jet.from_derivatives(q, np.eye(n)[i], 0.0, 0.0)
        np.testing.assert_allclose(machine.jacobian(q)[..., i], machine.forward(moving).derivatives()[1], atol=1e-11)


@pytest.mark.parametrize(('name', 'order'), [('planar', [0, 1]), ('four_dof', CORE_ORDER)])
def test_pairs_of_a_built_mechanism_are_that_mechanism(name, order):
    """The general module of two circles against the equations of the thesis: pose, Jacobian, error matrix."""
    machine = load_machine(name)
    core, q = pairs_of(machine), sample_joints(machine, 50, 1)
    pose = core.forward(q[:, order]) if name == 'four_dof' else np.stack(core.place(q), axis=-1)
    moves, stretches = core.rates(q[:, order])
    np.testing.assert_allclose(pose, machine.forward(q), atol=1e-14)
    np.testing.assert_allclose(moves[..., order], machine.jacobian(q), atol=1e-12)
    links = [0, 1, 3, 2, 4, 5] if name == 'four_dof' else [0, 1]
    expected = sensitivities(machine, q, [LINKS[name][i] for i in links])
    np.testing.assert_allclose(stretches, expected, atol=1e-6)  # the error of central differences


@pytest.mark.parametrize('name', NAMES)
def test_machine_without_masses_refuses_dynamics(name):
    machine = load_machine(name)
    for call in (machine.mass_matrix, machine.gravity, lambda q: default_motion(machine)):
        with pytest.raises(ConfigError, match=f'{name}: a l.* has kinematics only.*expected a machine with dynamics'):
            call(machine.home)


def test_pose_on_the_other_side_of_the_pivots_is_refused():
    linkage = load_machine('v_linkage')
    with pytest.raises(WorkspaceError, match='other side of its pivots; allowed: on their right'):
        linkage.inverse([0.0, 0.09])
    with pytest.raises(WorkspaceError, match='reach of its link'):
        linkage.inverse([0.2, 0.0])
    with pytest.raises(WorkspaceError, match='phi'):
        load_machine('parallel_layout').inverse([0.1095, 0.0989, 0.1237, 0.0])


@pytest.mark.parametrize(
    ('name', 'old', 'new', 'message'),
    [
        ('h_linkage', 'y: 118 mm', 'y: 130 mm', 'least distance from a singularity'),
        ('h_linkage', 'y: 118 mm', 'y: 150 mm', 'geometry.l2: at home: distance of the pivots = 150 mm'),
        ('h_linkage', 'side: right', 'side: above', "'left' or 'right'"),
        ('parallel_layout', 'y: 197.763 mm', 'y: 140 mm', 'allowed above 0 mm'),
        ('parallel_layout', 'd3: {lower: 119.5 mm', 'd3: {lower: 90 mm', 'joints.d1.upper 99.5 mm'),
    ],
)
def test_file_of_a_machine_that_cannot_work_is_refused(tmp_path, name, old, new, message):
    text = (Configuration.of_environment().folder / 'machines' / f'{name}.yaml').read_text()
    assert old in text
    path = tmp_path / 'edited.yaml'
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError, match=message):
        load_machine(path)
