"""Learning at the tool: law, convergence test, monitor, fall back, and what it learns on the simulated machine."""

from functools import cache

import numpy as np
import pytest

from pkm_core.control.axis import feedforward_gains
from pkm_core.control.margins import perturbed_models
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.control.systems import plant_system
from pkm_core.errors import ConfigError, LearningError
from pkm_core.learning import make_law
from pkm_core.learning.law import path_through
from pkm_core.learning.tool import ToolLearning, make_tool_law
from pkm_core.learning.tool_convergence import check_tool_law, tool_convergence
from pkm_core.learning.tool_law import ToolLaw, load_tool_law
from pkm_core.machines import load_machine
from pkm_core.machines.laser_clock import sample_numbers
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import added, to_joints
from pkm_core.simulation.cycles import run_cycles
from pkm_core.verbs.convergence import convergence as convergence_verb

UM = 1e6


@cache
def planned(name):
    machine = load_machine(name)
    poses = plan(machine, load_motion(default_motion(machine)))
    return machine, poses, to_joints(machine, poses), load_control(machine)


def tool_law(name='planar', **changes):
    machine, poses, joints, _ = planned(name)
    return ToolLaw(load_tool_law(machine).model_copy(update=changes), machine, poses, joints)


def seen_by_laser(name, first_tick, *, off=0.0):
    """Return time [s] and displacement of an exact laser; the tool is `off` [m] times its way from home too far."""
    machine, poses, _, _ = planned(name)
    time = sample_numbers(machine, first_tick, first_tick + len(poses)) * machine.laser_sample_time
    way = poses.position - poses.position[0]
    ticks = first_tick + np.arange(len(poses))
    exact = [np.interp(time / machine.sample_time, ticks, column) for column in way.T]
    return time, (1 + off) * np.stack(exact, axis=1)


def test_correction_goes_to_the_deviation_that_no_encoder_sees():
    """With encoder errors of zero, the tool follows the correction; each update removes the gain's share."""
    law, (machine, poses, joints, _) = tool_law(), planned('planar')
    wrong = machine.inverse(poses.position[0] + 1.001 * (poses.position - poses.position[0])) - joints.position
    correction = np.zeros_like(joints.position)
    for iteration in range(3):
        time, seen = seen_by_laser('planar', 720 * iteration, off=1e-3)
        left = law.tool_error(720 * iteration, time, seen) - correction  # a machine that follows: y = r + dr
        correction = law.update(correction, left, np.zeros_like(left), iteration)
    rest = poses.move_ends[0] + 60  # at the target
    assert correction[rest] == pytest.approx(-(1 - 0.7**3) * wrong[rest], rel=0.02)
    assert abs(correction[:40].mean(axis=0)).max() < 2e-9  # nothing at home


def test_encoder_errors_are_left_to_the_joints():
    law, (_, _, joints, _) = tool_law(), planned('planar')
    error = 5e-6 * np.random.default_rng(2).standard_normal(joints.position.shape)
    correction = law.update(np.zeros_like(error), error, error, 0)
    assert not correction.any()


def test_frequencies_above_the_band_are_not_learned():
    law, (machine, _, joints, _) = tool_law(), planned('planar')
    tick, zeros = np.arange(len(joints)), np.zeros_like(joints.position)
    for frequency, learned in ((100.0, 0.3), (130.0, 0.15), (151.4, 0.0)):
        cycles = round(frequency * len(joints) * machine.sample_time)
        wave = 1e-6 * np.sin(2 * np.pi * cycles * tick / len(joints))[:, np.newaxis] * np.ones(2)
        change = law.update(zeros, wave, zeros, 0)
        assert np.ptp(change) / np.ptp(wave) == pytest.approx(learned, abs=0.02), frequency


def test_derivatives_are_those_of_the_corrected_position():
    law, (machine, _, joints, _) = tool_law(), planned('planar')
    tick = np.arange(len(joints))[:, np.newaxis]
    angle = 2 * np.pi * 20 * tick / len(joints) * np.ones(2)  # 56 Hz
    w = 2 * np.pi * 20 / (len(joints) * machine.sample_time)
    found = added(joints, law.motion_of(1e-6 * np.sin(angle)))
    for order, name in enumerate(('position', 'velocity', 'acceleration', 'jerk')):
        part = getattr(found, name) - getattr(joints, name)
        wanted = 1e-6 * w**order * np.sin(angle + order * np.pi / 2)
        np.testing.assert_allclose(part, wanted, atol=1e-6 * 1e-6 * w**order + 1e-9 * abs(getattr(joints, name)).max())


@pytest.mark.parametrize('name', ['planar', 'four_dof'])
def test_shipped_law_passes_its_test_beside_the_best_law(name):
    machine, poses, joints, gains = planned(name)
    law = make_tool_law(machine, gains, make_law('inverse', machine, gains), poses, joints)
    assert law.verdict.startswith('learning at the tool converges: the error up to 110 Hz is multiplied by at most 0.9')


def test_verb_prints_the_verdict_at_the_tool(capsys):
    convergence_verb('planar', 'inverse', 'robust', None, None, learning_target='tool')
    assert 'learning at the tool converges: the error up to 110 Hz' in capsys.readouterr().out


def test_tool_mode_within_the_band_is_refused_with_its_frequency():
    machine, _, _, gains = planned('planar')
    config = load_tool_law(machine).model_copy(update={'lowest_mode': 120.0})
    with pytest.raises(LearningError, match=r'would diverge: the error of d\d at 120\.0 Hz is multiplied by \d+'):
        check_tool_law(config, machine, gains, load_model(machine), make_law('inverse', machine, gains))


def test_factor_is_that_of_the_correction_from_cycle_to_cycle():
    """At 60 Hz, on a perturbed model, without a law of the joints."""
    machine, _, _, gains = planned('planar')
    config = load_tool_law(machine).model_copy(update={'gain': (0.3,), 'jacobian_error': 0.0, 'lowest_mode': 170.0})
    model = load_model(machine)['d1']
    found = tool_convergence(config, machine, gains['d1'], model, None, 'd1')
    f = np.array([60.0])
    z, s = np.exp(2j * np.pi * f * machine.sample_time), 2j * np.pi * f
    number, plant = 4, perturbed_models(model)[4]
    G = path_through(gains['d1'], plant_system(plant, machine.sample_time)(z), z, machine.sample_time)
    kv, ka, kj = feedforward_gains(gains['d1'], model, machine.sample_time)
    T = G * (gains['d1'].pid_response(z, machine.sample_time) + kv * s + ka * s**2 + kj * s**3)
    H = 1 + f**2 / (170.0**2 - f**2 + 2j * config.mode_damping * 170.0 * f)
    factors = {}
    for shape, tool in (('rigid', 1.0), ('elastic', H)):
        correction, sizes = np.array([1.0 + 0j]), []
        for _ in range(6):
            encoders, laser = (1 - T) * correction, -tool * T * correction  # r + dr - y, and r - x
            correction = correction + 0.3 * (laser - encoders)
            sizes.append(abs(correction[0]))
        factors[shape] = sizes[-1] / sizes[-2]
    at = list(found.frequency).index(60.0)
    assert found.factor[number, at] == pytest.approx(max(factors.values()), rel=1e-9)


@pytest.mark.parametrize(
    ('line', 'reason'),
    [
        ('gain: [0.5]', r'gain\.0: 0\.5 given'),
        ('flat_to: 160 Hz', 'expected flat_to < zero_at'),
        ('zero_at: 150', 'unit'),
    ],
)
def test_file_of_the_law_is_strict(tmp_path, line, reason):
    machine = load_machine('planar')
    text = machine.configuration.find('learning/tool', 'laser').read_text()
    key = line.partition(':')[0]
    lines = [line if row.startswith(f'{key}:') else row for row in text.splitlines()]
    path = tmp_path / 'laser.yaml'
    path.write_text('\n'.join(lines))
    with pytest.raises(ConfigError, match=reason):
        load_tool_law(machine, path)


def test_band_above_half_the_rate_of_the_laser_is_refused():
    with pytest.raises(LearningError, match='zero_at 700 Hz; allowed below 625 Hz'):
        tool_law(zero_at=700.0)


def test_laser_that_falls_silent_leaves_learning_to_the_joints():
    learning, (_, _, joints, _) = ToolLearning(tool_law()), planned('planar')
    error, notices, corrections = np.zeros_like(joints.position), [], []
    for cycle in range(5):
        time, seen = seen_by_laser('planar', 720 * cycle, off=1e-3)
        if cycle in (1, 2):
            time, seen = time[:200], seen[:200]
        notices.append(learning.after_cycle(error, 720 * cycle, time, seen))
        corrections.append(learning.correction)
    assert notices == [
        '',
        'learning at the tool: laser: no sample from 159.2 to 360.0 ms of the cycle; allowed gaps up to 4 ms; '
        'the correction is kept, only the joints learn',
        '',
        'learning at the tool continues',
        '',
    ]
    assert corrections[0] is corrections[1] is corrections[2]
    assert (corrections[3] != corrections[2]).any()


def test_correction_beyond_a_limit_is_not_used():
    """A laser with a wrong scale asks for a reference outside the travel."""
    learning, (_, _, joints, _) = ToolLearning(tool_law()), planned('planar')
    time, seen = seen_by_laser('planar', 0, off=200.0)
    notice = learning.after_cycle(np.zeros_like(joints.position), 0, time, seen)
    assert notice.startswith('learning at the tool: row 73: d1 = ')
    assert notice.endswith('the correction is kept, only the joints learn')
    assert learning.reference is joints


def test_monitor_takes_a_diverging_correction_back():
    """A laser whose sign is wrong: the correction grows by its gain per cycle until the monitor detects it."""
    learning, (machine, _, joints, gains) = ToolLearning(tool_law()), planned('planar')
    learning.law._inverse = -learning.law._inverse
    records = run_cycles(machine, joints, gains, make_law('inverse', machine, gains), 12, 2, tool=learning)
    assert any('learning of the tool diverges' in notice for notice in records.notices)
    assert 'returned to the correction with' in ' '.join(records.notices)


def test_tool_learning_removes_errors_no_encoder_sees():
    machine, poses, joints, gains = planned('planar')
    law = make_law('inverse', machine, gains)
    errors = {}
    for target in ('joints', 'tool'):
        tool = ToolLearning(make_tool_law(machine, gains, law, poses, joints)) if target == 'tool' else None
        records = run_cycles(machine, joints, gains, law, 16, 2, laser=True, tool=tool)
        rest = slice(poses.move_ends[0] + 40, poses.move_starts[1])
        off = (poses.position - poses.position[0] - records.truth[-1])[rest]
        errors[target] = UM * abs(off.mean(axis=0)).max()
        assert records.notices == ()
    assert errors['joints'] > 15  # the links of specimen 2: 20 um in x
    assert errors['tool'] < 2  # 0.7 to the power of the updates
    np.testing.assert_array_equal(records.correction[-1] == 0, False)
