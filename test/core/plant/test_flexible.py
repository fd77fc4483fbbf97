"""Modes that react: energy, rigid limit, response at home, pose, repetition, refusals; other machines unchanged."""

import shutil

import numpy as np
import pytest

from pkm_core.config import Configuration
from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine
from pkm_core.plant.arrays import BEND_PARAMETERS
from pkm_core.plant.flexible import direction
from pkm_core.plant.flexible_design import design_bends, directions, home_terms, second_order
from pkm_core.plant.linear import sampled_plants
from pkm_core.plant.plant import Plant
from pkm_core.plant.truth import load_truth

MACHINES = ('four_dof', 'planar')
FLEXIBLE = 'flexible:\n      mass: 1 %'
# of nominal by the plant of 8 modes in series, at ticks 99, 199, 299 and 399
COUNTS = [
    [397613, 697957, 698048, 395282],
    [397146, 696982, 698222, 393677],
    [397325, 696560, 698230, 393410],
    [395868, 696994, 697232, 390873],
]
VISCOSITIES = ('26.38', '21.03', '15.21', '41.15')


@pytest.fixture
def altered(tmp_path):
    """Return a function: four_dof whose environment flexible is ideal but for its modes, with further replacements."""

    def make(*replacements):
        shutil.copytree(Configuration.of_environment().folder, tmp_path / 'config', dirs_exist_ok=True)
        path = tmp_path / 'config' / 'truth' / 'four_dof.yaml'
        text = (Configuration.of_environment().folder / 'truth' / 'four_dof.yaml').read_text()
        section = text[text.index('    flexible:\n') :]
        head, rest = text[: text.index('  flexible:  #')].split('  nominal:', 1)
        ideal = head[head.index('  ideal:') :].split('\n', 1)[1].replace('modes: false', 'modes: true')
        text = f'{head}  nominal:{rest}  flexible:\n{ideal}{section}'
        for old, new in (('mass: 2.3 g', 'mass: 0 g'), *replacements):
            assert old in text
            text = text.replace(old, new)
        path.write_text(text)
        return Plant(load_machine('four_dof', Configuration(tmp_path / 'config')), 1, 'flexible')

    return make


def driven(plant, volts):
    """Return the true positions of the scales (T, n) under `volts` (T, n)."""
    positions = []
    for row in volts:
        plant.tick(row)
        positions.append(plant.truth.q)
    return np.array(positions)


def response(system, z):
    """Return the transfer matrix (m, n, n) of (A, B, C) at the points `z` (m,)."""
    A, B, C = system
    return C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (z.size, *B.shape)))


@pytest.mark.parametrize('name', MACHINES)
def test_each_axis_has_its_identified_response_at_home(name):
    """Force on an axis to its own scale, the others free: the series model within 0.01 % to 500 Hz, 0.1 % to 950 Hz."""
    machine = load_machine(name)
    frequency = np.arange(20.0, 950.0, 0.5)
    z = np.exp(2j * np.pi * frequency * machine.sample_time)
    series, shared = (
        response(sampled_plants(machine, environment, [machine.home])[0], z) for environment in ('nominal', 'flexible')
    )
    for i in range(len(machine.joints)):
        off = np.abs(shared[:, i, i] / series[:, i, i] - 1.0)
        assert off[frequency <= 500.0].max() < 1e-4
        assert off.max() < 1e-3
    partner = np.abs(shared[:, 0, 1])[np.abs(frequency - 240.0) < 20.0].max()
    assert partner > 0.3 * np.abs(series[:, 0, 0])[np.abs(frequency - 240.0) < 20.0].max()


@pytest.mark.parametrize('name', MACHINES)
def test_modes_change_with_the_pose(name):
    """The directions grow as the pair opens and the lowest resonance moves by more than 0.5 %."""
    machine = load_machine(name)
    truth, levels = load_truth(machine, 'flexible')
    parameters, _ = design_bends(machine, truth, levels)
    M, _ = home_terms(machine, truth)
    wide = machine.home + np.array([-0.01, 0.01] if name == 'planar' else [-0.01, 0.01, 0.01, -0.01])
    np.testing.assert_allclose(np.abs(directions(parameters, machine.home)).max(axis=1), 1.0, rtol=1e-12)
    assert (np.abs(directions(parameters, wide)).max(axis=1) > 1.3).all()
    lowest = []
    for q in (machine.home, wide):
        mass, _, stiffness = second_order(parameters, q, M, np.zeros(len(q)))
        values = np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real
        lowest.append(np.sqrt(values[values > 1.0].max()))
    assert abs(lowest[1] / lowest[0] - 1.0) > 5e-3


def test_direction_is_a_gradient_with_its_acceleration():
    """J of a mode against differences of the height of its pair, and Jdot qd against those of J."""
    mode = np.zeros(1, BEND_PARAMETERS)
    mode['lower'], mode['higher'], mode['link'], mode['across'] = 0, 1, 0.07, 1.0
    mode, q, qd, h = mode[0], np.array([0.08, 0.14]), np.array([0.3, -0.2]), 1e-6
    rows = np.zeros((3, 2))
    bias = direction(mode, q, qd, rows[0])
    for row, sign in ((1, -1.0), (2, 1.0)):
        direction(mode, q + sign * h * qd, qd, rows[row])
    assert bias == pytest.approx((rows[2] - rows[1]) @ qd / (2.0 * h), rel=1e-6)
    height = [np.sqrt(0.07**2 - (0.5 * (q[1] - q[0] - s * h)) ** 2) for s in (-1.0, 1.0)]
    assert rows[0, 0] == pytest.approx((height[1] - height[0]) / (2.0 * h), rel=1e-6)
    assert rows[0, 1] == -rows[0, 0]


def test_undamped_flexible_machine_conserves_energy(altered):
    """Energy of joints, masses on the links and springs over 40 ms of free motion, gravity included."""
    plant = altered(*((f'viscosity: {a} 1/s', 'viscosity: 0 1/s') for a in VISCOSITIES))
    plant._built.bend_parameters['damping'] = 0.0
    plant.reset()
    machine, parameters = plant.machine, plant._built.bend_parameters
    extra = plant._built.parameters['extra_mass']

    def energy():
        motion, bends = plant._arrays.motion, plant._arrays.bends
        q, qd = motion[0], motion[1]
        coupling = parameters['mass'] * (directions(parameters, q) @ qd)
        lifted = 0.147 * 64.35 / 116.6 + 0.13 * 69.77 / 116.6 + 0.027  # links 10, 12 rise by their share of z
        total = 0.5 * qd @ (machine.mass_matrix(q) + np.diag(extra)) @ qd + 9.81 * lifted * machine.forward(q)[2]
        springs = 0.5 * parameters['stiffness'] @ bends[:, 0] ** 2
        return total + coupling @ bends[:, 1] + 0.5 * parameters['mass'] @ bends[:, 1] ** 2 + springs, springs

    driven(plant, np.vstack([np.tile([1.0, -0.8, 0.9, 0.7], (30, 1)), np.zeros((2, 4))]))
    start, energies = energy()[0], []
    for _ in range(80):
        plant.tick(np.zeros(4))
        energies.append(energy())
    whole, springs = np.array(energies).T
    assert np.abs(plant.truth.rigid_q - machine.home).max() > 5e-3
    assert springs.max() > 1e-6
    # the integration leaves an oscillation of (w h)^2/24 of the energy of the modes, and no drift
    assert np.abs(whole - start).max() < 0.02 * springs.max()
    assert abs(whole[40:].mean() - whole[:40].mean()) < 0.002 * springs.max()


def test_stiff_modes_give_the_rigid_machine(altered):
    """With resonances far above, the difference to the machine without modes falls with their square."""
    volts = 0.3 * np.sin(0.05 * np.arange(120))[:, None] * np.array([1.0, -1.0, 1.0, 0.8])
    rigid = driven(Plant(altered().machine, 1, 'ideal'), volts)
    differences = []
    truth = load_truth(load_machine('four_dof'), 'flexible')[0]
    for factor in (1.5, 3.0):
        replacements = []
        for axis in truth.axes.values():
            for mode in axis.modes:
                for key in ('resonance', 'antiresonance'):
                    value = getattr(mode, key)
                    replacements.append((f'{key}: {value:g} Hz', f'{key}: {factor * value:g} Hz '))
        stiff = driven(altered(*replacements), volts)
        differences.append(np.abs(stiff - rigid).max())
    assert differences[1] < 0.35 * differences[0]
    assert differences[1] < 0.01 * np.abs(rigid - rigid[0]).max()


@pytest.mark.parametrize('name', MACHINES)
def test_flexible_machine_repeats_and_returns_to_rest(name):
    machine = load_machine(name)
    volts = np.random.default_rng(2).normal(0.0, 0.3, (200, len(machine.joints)))
    first, second = (Plant(machine, 7, 'flexible') for _ in range(2))
    readings = [first.tick(row) for row in volts]
    np.testing.assert_array_equal([second.tick(row) for row in volts], readings)
    first.reset()
    np.testing.assert_array_equal([first.tick(row) for row in volts], readings)
    for _ in range(2000):
        first.tick(0.0 * volts[0])
    np.testing.assert_allclose(first.truth.q, first.truth.rigid_q, atol=0.05e-6)


@pytest.mark.parametrize('name', [*MACHINES, 'xy_stage'])
def test_other_environments_have_no_mode_that_reacts(name):
    """Their ticks skip the code of the modes, so they keep their bits, and their modes stay in series."""
    machine = load_machine(name)
    for environment in load_truth(machine, 'nominal')[0].environments:
        arrays = Plant(machine, 1, environment)._built
        assert (arrays.bends.size > 0) == (environment == 'flexible')
        assert arrays.modes.shape[1] == (0 if environment in ('ideal', 'flexible') else arrays.modes.shape[1])
        assert arrays.scales.any() == (environment == 'flexible')


def test_series_plant_keeps_the_positions_of_version_before():
    """Encoder counts of nominal as before modes could react, printed by that version."""
    plant = Plant(load_machine('four_dof'), 3, 'nominal')
    volts = np.random.default_rng(2).normal(0.0, 0.5, (400, 4))
    counts = [plant.tick(row) for row in volts]
    assert [counts[k].tolist() for k in (99, 199, 299, 399)] == COUNTS


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        (FLEXIBLE, 'flexible:\n      mass: 1', r'flexible.mass: 1'),
        (FLEXIBLE, 'flexible:\n      mass: 20 %', r"flexible.mass: '20 %' given"),
        (FLEXIBLE, 'flexible:\n      mass: 0 %', r"flexible.mass: '0 %' given"),
        (FLEXIBLE, 'flexible:\n      mas: 1 %', r'flexible.mas'),
        ('shared: 100 %', 'shared: 120 %', r"flexible.shared: '120 %' given"),
        ('[across, across]', '[across, down]', r'flexible.directions'),
        ('[across, across]', '[across]', r'flexible.directions: 1 given; d1 has 2 modes'),
        ('mode_shift: 0 %', 'mode_shift: 3 %', r'mode_shift 3 %; allowed with modes true'),
        ('modes: true', 'modes: false', r'flexible given with modes False'),
        (FLEXIBLE, 'flexible:\n      mass: 2 %', r'no springs and dampers give the resonances .*less mass'),
        (FLEXIBLE, 'flexible:\n      mass: 9 %', r'the modes take \d+ % of the mass of the axes'),
    ],
)
def test_wrong_flexible_modes_are_refused_by_key(old, new, message, tmp_path):
    machine = load_machine('four_dof')
    text = (Configuration.of_environment().folder / 'truth' / 'four_dof.yaml').read_text()
    head, section = text.split('  flexible:  #', 1)
    assert old in section
    (tmp_path / 'truth').mkdir()
    (tmp_path / 'truth' / 'four_dof.yaml').write_text(f'{head}  flexible:  #{section.replace(old, new, 1)}')
    wrong = machine.with_configuration(Configuration(tmp_path))
    with pytest.raises(ConfigError, match=message):
        design_bends(wrong, *load_truth(wrong, 'flexible'))


def test_stage_without_link_pairs_refuses_flexible_modes(tmp_path):
    machine = load_machine('xy_stage')
    text = (Configuration.of_environment().folder / 'truth' / 'xy_stage.yaml').read_text()
    given = '    flexible: {mass: 1 %, shared: 0 %, directions: [across]}\n'
    (tmp_path / 'truth').mkdir()
    (tmp_path / 'truth' / 'xy_stage.yaml').write_text(text.replace('  hard:', f'{given}  hard:', 1))
    with pytest.raises(ConfigError, match=r'flexible given; x has no pair in stops.carriages or no gain'):
        load_truth(machine.with_configuration(Configuration(tmp_path)), 'nominal')
