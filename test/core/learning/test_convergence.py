"""The convergence test of every law on every loop, the advance of the Fourier law, and the loops of the thesis."""

import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from pkm_core.config import find_config
from pkm_core.control.margins import perturbed_models, stability_margins, worst_margins
from pkm_core.control.model import Forces
from pkm_core.control.robust import load_control
from pkm_core.errors import LearningError, PkmError
from pkm_core.learning import law_names, make_law, untested_law
from pkm_core.learning.convergence import checked, convergence
from pkm_core.learning.convergence_report import convergence_figures, convergence_table, plot_convergence
from pkm_core.learning.law import learned_path
from pkm_core.machines import load_machine
from pkm_core.verbs.convergence import convergence as convergence_verb

LOOPS = {'four_dof': 'four_dof', 'planar': 'planar', 'four_dof_thesis': 'four_dof', 'planar_thesis': 'planar'}


@cache
def law(name, loops):
    machine = load_machine(LOOPS[loops])
    return untested_law(name, machine, load_control(machine, loops))


@cache
def factors(name, loops):
    return {joint: convergence(law(name, loops), joint) for joint in law(name, loops).gains}


@pytest.mark.parametrize('loops', LOOPS)
@pytest.mark.parametrize('name', law_names())
def test_every_law_converges_on_all_perturbed_models(name, loops):
    for joint, found in factors(name, loops).items():
        # 9 perturbations for every choice of sides of the two pairs of zeros; the model itself comes first
        assert found.factor.shape == (36, found.frequency.size)
        assert found.factor[0].max() <= found.worst < 1, joint


@pytest.mark.parametrize('loops', LOOPS)
@pytest.mark.parametrize('name', ['fourier', 'fourier_pid'])
def test_fourier_law_does_not_amplify_what_it_does_not_learn(name, loops):
    for found in factors(name, loops).values():
        assert found.worst <= law(name, loops).config.forgetting + 1e-12


@pytest.mark.parametrize(
    ('name', 'worst'), [('inverse', 0.67), ('norm_optimal', 0.45), ('basis', 0.67), ('fourier_pid', 0.998)]
)
def test_worst_factor_is_that_of_the_configuration_file(name, worst):
    for loops in ('four_dof', 'planar'):
        assert max(found.worst for found in factors(name, loops).values()) <= worst


@pytest.mark.parametrize('loops', ['four_dof_thesis', 'planar_thesis'])
def test_thesis_law_halves_the_error_of_a_move_in_three_cycles(loops):
    """On the loops of the thesis."""
    for found in factors('fourier', loops).values():
        move = (found.frequency >= 10) & (found.frequency <= 60)
        assert found.factor[:, move].max() ** 3 < 0.5


@pytest.mark.parametrize('loops', LOOPS)
def test_without_its_advance_the_fourier_law_diverges_slowly(loops):
    printed = law('fourier', loops).as_printed()
    for joint in printed.gains:
        found = convergence(printed, joint)
        assert 1.2 < found.worst < 1.5
        first = found.frequency[(found.factor.max(axis=0) > 1).argmax()]
        assert 25 < first < 65  # Hz; from there on the loop's delay turns the action by more than 90 deg


def test_advance_is_the_delay_of_the_loop():
    the_law = law('fourier_pid', 'four_dof')
    for joint, samples in the_law.advance.items():
        # compensates the phase of T = PID G at half weight, 161 Hz, within half a sample
        action = the_law.action(joint, np.array([161.0]))
        phase = np.angle(action * the_law.path(joint, np.array([161.0])), deg=True)[0]
        assert abs(phase) <= 0.5 * 360 * 161 * 0.5e-3
        assert samples in (6, 7)  # about 3 ms: 1.5 ms of computation, hold and filters, the rest is that of the loop


def test_factor_is_that_of_the_iteration_at_every_frequency():
    the_law, joint, samples = law('inverse', 'planar'), 'd3', 800
    frequency = np.fft.rfftfreq(samples, 0.5e-3)
    model = perturbed_models(the_law.models[joint])[4]
    path = np.zeros(frequency.shape, dtype=complex)
    path[1:] = learned_path(the_law.gains[joint], model, frequency[1:], 0.5e-3)
    harmonic = 40  # 100 Hz
    first = 1e-6 * np.cos(2 * np.pi * harmonic * np.arange(samples) / samples)
    spectrum, memory, gain = np.fft.rfft(first), the_law.memory(joint, frequency), max(the_law.config.gain)
    feedforward, errors = np.zeros(frequency.shape, dtype=complex), []
    for _ in range(3):
        error = spectrum - path * feedforward
        errors.append(error[harmonic])
        feedforward = memory * feedforward + gain * the_law.action(joint, frequency) * error
    found = factors('inverse', 'planar')[joint]
    # full weight at 100 Hz: the error of the fixed point is zero
    expected = found.factor[4, list(found.frequency).index(100.0)]
    assert abs(errors[1] / errors[0]) == pytest.approx(expected, rel=1e-9)
    assert abs(errors[2] / errors[1]) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(('gain', 'frequency'), [(1.0, 50.0), (0.4, 50.0), (0.7, 190.0)])
def test_noise_is_amplified_as_documented(gain, frequency):
    """Model 20 % too weak, errors of pure noise: var E = s^2 (1 + g^2 |AG|^2/(1 - |mu|^2))."""
    the_law, joint, f = law('inverse', 'planar'), 'd1', np.array([frequency])
    model = the_law.models[joint]
    stronger = model.model_copy(update={'gain': 1.2 * model.gain})
    path = learned_path(the_law.gains[joint], stronger, f, 0.5e-3)
    memory, action = the_law.memory(joint, f), gain * the_law.action(joint, f)
    noise = np.random.default_rng(8).standard_normal((400, 4000, 2)) @ [1.0, 1.0j]
    feedforward, power = np.zeros(400, dtype=complex), []
    for each in noise.T:
        error = each - path * feedforward
        feedforward = memory * feedforward + action * error
        power.append(np.mean(np.abs(error) ** 2))
    factor = abs(memory - action * path)[0]
    expected = 2.0 * (1 + abs(action * path)[0] ** 2 / (1 - factor**2))  # power of the noise: 2
    assert np.mean(power[100:]) == pytest.approx(expected, rel=0.01)  # 1.5 million draws: 0.1 %


def test_page_on_learning_quotes_the_factors_of_the_shipped_laws():
    text = (Path(__file__).parents[3] / 'docs' / 'learning.md').read_text(encoding='utf-8')
    rows = re.findall(
        r'^\| (\w+)(, [^|]*)? \| (\d\.\d+); (\d\.\d+) \|[^|]*\| (?:(\d\.\d+); (\d\.\d+))? *\|$', text, re.MULTILINE
    )
    assert len(rows) == 7
    assert {row[0] for row in rows} == set(law_names())
    for name, variant, *worst, four_dof_move, planar_move in rows:
        loops = LOOPS if 'thesis' not in variant else ('four_dof_thesis', 'planar_thesis')
        for each, quoted, move in zip(loops, worst, (four_dof_move, planar_move), strict=False):
            the_law = law(name, each)
            if 'no advance' in variant:
                the_law = the_law.as_printed()
            found = convergence_figures(the_law).values()
            assert max(row['worst'] for row in found) == pytest.approx(
                float(quoted), abs=5.1 * 10.0 ** -len(quoted) * 10
            )
            if move:
                assert max(row['worst_in_move_band'] for row in found) == pytest.approx(float(move), abs=5.1e-4)


def test_law_that_would_diverge_is_refused_with_the_factor():
    the_law = untested_law('fourier', load_machine('planar'), load_control(load_machine('planar')))
    the_law.config = the_law.config.model_copy(update={'derivative': 1.0})
    with pytest.raises(
        LearningError, match=r'would diverge: the error of d3 at 1\d\.\d Hz is multiplied by 1\.\d+ per cycle'
    ):
        checked('fourier', the_law)


def test_verdict_of_a_law_has_its_worst_factor():
    machine = load_machine('planar')
    verdict = make_law('inverse', machine, load_control(machine)).verdict
    worst = max(found.worst for found in factors('inverse', 'planar').values())
    assert verdict.startswith("learning law 'inverse' converges: at worst the error of d1 at 16")
    assert f'is multiplied by {worst:.3f} per cycle (gain +20%, modes -5%, zeros ' in verdict


def test_law_with_wrong_sign_is_refused():
    the_law = untested_law('inverse', load_machine('planar'), load_control(load_machine('planar')))
    right = the_law.action
    the_law.action = lambda joint, frequency: -right(joint, frequency)
    with pytest.raises(LearningError, match=r'multiplied by 2\.\d+ per cycle \(gain \+20%'):
        checked('inverse', the_law)


def test_make_law_runs_the_test(tmp_path):
    machine = load_machine('planar')
    text = find_config('learning', 'inverse').read_text().replace('160 Hz', '260 Hz').replace('208 Hz', '300 Hz')
    (tmp_path / 'wide.yaml').write_text(text)
    for _ in range(2):  # a law that failed is not cached as one that passed
        with pytest.raises(LearningError, match=r"wide.yaml' would diverge"):
            make_law(str(tmp_path / 'wide.yaml'), machine, load_control(machine))


def test_law_is_tested_again_for_other_gains():
    machine = load_machine('planar')
    gains = load_control(machine)
    make_law('fourier_pid', machine, gains)
    weak = gains['d3'].model_copy(update={'kp': 1500.0, 'kd': 9.0, 'ki': 30000.0})
    with pytest.raises(LearningError, match=r"'fourier_pid' would diverge: the error of d3"):
        make_law('fourier_pid', machine, gains | {'d3': weak})


def stiffer(model):
    """A model of three times the gain: G_true/G reaches far above 2."""
    return model.model_copy(update={'gain': 3 * model.gain})


@pytest.mark.parametrize('loops', ['four_dof_thesis', 'planar_thesis'])
def test_thesis_loops_keep_the_margins_of_the_thesis(loops):
    the_law = law('fourier', loops)
    for joint, gains in the_law.gains.items():
        margins = stability_margins(gains, the_law.models[joint], 0.5e-3)
        assert margins.gain_margin >= 7.0  # (7.26)
        assert 45.0 <= margins.phase_margin <= 60.0  # (7.27)
        assert margins.peak_sensitivity <= 1.85
        worst = worst_margins(gains, the_law.models[joint], 0.5e-3)
        assert worst.stable
        assert worst.gain_margin >= 5.0
        assert worst.phase_margin >= 38.0
        assert gains.ki / gains.kp == pytest.approx(5.0, rel=1e-3)  # 1/s


def test_report_has_the_law_with_and_without_advance(tmp_path):
    figures = convergence_figures(law('fourier', 'planar_thesis'))
    assert figures['d1']['converges']
    assert figures['d1']['worst_as_printed'] > 1.2
    console = Console(width=100, record=True, file=(tmp_path / 'table').open('w'))
    console.print(convergence_table('title', figures))
    assert '0.995' in console.export_text()
    plot_convergence('title', figures, tmp_path / 'figure.png')
    assert (tmp_path / 'figure.png').read_bytes().startswith(b'\x89PNG')


def test_verb_writes_figures_and_picture(tmp_path, capsys):
    convergence_verb('planar', 'inverse', 'robust', tmp_path / 'out', tmp_path / 'figures.json')
    assert 'converges on all models' in capsys.readouterr().out
    written = json.loads((tmp_path / 'figures.json').read_text())
    assert written['law'] == 'inverse'
    assert 0.4 < written['joints']['d3']['worst'] < 0.65
    assert (tmp_path / 'out' / 'convergence_planar_inverse.png').exists()


@pytest.mark.parametrize(
    ('machine', 'law_name', 'control', 'reason'),
    [('planar', 'magic', 'robust', "'magic' is unknown"), ('planar', 'inverse', 'four_dof', 'joints are')],
)
def test_verb_refuses_what_does_not_exist_or_fit(machine, law_name, control, reason):
    with pytest.raises(PkmError, match=reason):
        convergence_verb(machine, law_name, control, None, None)


@pytest.mark.parametrize('name', ['inverse', 'norm_optimal', 'basis'])
def test_band_follows_the_lowest_identified_mode(name):
    """Modes lower by 15 %, from 194 Hz: with the band of the configuration the laws would be refused."""
    machine = load_machine('four_dof')
    given = untested_law(name, machine, load_control(machine))
    forces = Forces(coulomb=0.05, slip=10e-6, coupling=1.0)

    def lower(model, **changes):
        shifted = [mode.model_copy(update={key: 0.85 * getattr(mode, key) for key in ('resonance', 'antiresonance')})
                   for mode in model.modes]  # fmt: skip
        return model.model_copy(update={'modes': tuple(shifted), **changes})

    shipped = dict(given.models)
    given.models = {joint: lower(model, forces=forces) for joint, model in shipped.items()}
    assert given.band('d5').fall_to == pytest.approx(0.85 * given.config.band.fall_to)
    assert max(convergence(given, joint).worst for joint in given.gains) < 0.9
    given.models = {joint: lower(model) for joint, model in shipped.items()}
    with pytest.raises(LearningError, match='would diverge'):
        checked(name, given)
