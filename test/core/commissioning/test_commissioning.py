"""Commissioning: what is applied, what is refused, and what is restored."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from pkm_core.commissioning.acceptance import excess, friction_error
from pkm_core.commissioning.config_copy import copy_config
from pkm_core.commissioning.measured import MeasuredResponse, check_measured
from pkm_core.commissioning.procedure import Calibrated, Identified, commission
from pkm_core.commissioning.report import candidate_table, end_point_table, error_table, verdict, write_page
from pkm_core.commissioning.simulated_bench import SimulatedBench
from pkm_core.config import Configuration
from pkm_core.control.margins import perturbed_models, stability_margins, unit_circle
from pkm_core.control.model import Forces, load_model
from pkm_core.control.robust import load_control
from pkm_core.control.systems import plant_system
from pkm_core.design.pose_plan import spread_poses
from pkm_core.design.verification import Verification
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.motion.metrics import AxisMetrics
from pkm_core.motion.planning import default_motion, load_motion
from pkm_core.simulation.true_rests import true_rests
from pkm_core.tuning.config import load_tuning

UM = 1e-6


@pytest.fixture(scope='module')
def planar():
    return load_machine('planar')


@pytest.fixture
def place(planar, tmp_path):
    return copy_config(planar, tmp_path, 'nominal')


def response_of(model, machine, name='d1_sweep_0', coherence=1.0):
    """Return the response that a sweep without noise measures of an axis."""
    frequency = np.arange(80.0, 500.0, 2.0)
    plant = plant_system(model, machine.sample_time)(unit_circle(frequency, machine.sample_time))
    return MeasuredResponse(name, machine.home[0], frequency, plant, np.full(frequency.size, coherence))


class Bench:
    """A bench with axes as in `truth` and with moves whose errors are given by the test."""

    def __init__(self, machine, place, *, responses_of=response_of, errors=None, calibrated=None):
        self._machine, self._place, self._responses_of = machine, place, responses_of
        self._errors = {'as_found': 50 * UM, 'tuned': 20 * UM, 'restored': 50 * UM, 'inverse': 20 * UM} | (errors or {})
        self._calibrated = calibrated  # a `Calibrated`, or the error that is raised
        self.started = []  # (name, model, gains of d1) that ran
        self.moves = []

    def start(self, name):
        machine = self._machine
        self.started.append((name, load_model(machine)['d1'].gain, load_control(machine)['d1'].kp))

    def identify(self, on_step):
        on_step('identifying', 0.0)
        folder = self._place.configuration.folder.parent / 'identified'
        folder.mkdir()
        file = folder / 'model.yaml'
        file.write_text(self._place.model_file.read_text().replace('gain: 11440', 'gain: 9800'))
        models = load_model(self._machine, file)
        responses = {joint: [self._responses_of(model, self._machine)] for joint, model in models.items()}
        return Identified(file, responses, ['d1: a warning'])

    def calibrate(self, on_step):
        self.moves.append('calibrate')
        if isinstance(self._calibrated, Exception):
            raise self._calibrated
        return self._calibrated

    def move(self, cycles, law, on_step):
        name = self.started[-1][0] if law == 'none' else law
        self.moves.append((name, cycles, law))
        error = self._errors[name]
        if isinstance(error, Exception):
            raise error
        return [[AxisMetrics(error / (1 + cycle), 0.0, np.nan, 0.0)] * 2 for cycle in range(cycles)]


@pytest.fixture(scope='module')
def small():
    """Return a search that takes about 1 s."""
    config = load_tuning()
    search = config.search.model_copy(update={'population': 32, 'generations': 10, 'restarts': 1})
    return config.model_copy(update={'search': search})


def calibrated(file, reasons=()):
    """Return a `Calibrated` whose errors go from 8 to 0.1 um."""
    rows = (np.full(2, value * UM) for value in (0.05, 8.0, 0.1, 12.0, 0.2))
    return Calibrated(file, list(reasons), 1.02, Verification(('x', 'y'), 8, *rows))


def run(bench, place, config, folder, calibrate=False):
    steps = []
    with ThreadPoolExecutor(1) as executor:
        outcome = commission(
            place.machine, bench, place, config, law='inverse', cycles=3, limit=30 * UM, seed=1, executor=executor,
            folder=folder / 'search', on_step=lambda *step: steps.append(step), calibrate=calibrate,
        )  # fmt: skip
    return outcome, steps


def test_gains_that_pass_are_kept_and_the_motion_is_learned(planar, place, small, tmp_path):
    found_model, found_kp = load_model(planar)['d1'].gain, load_control(planar)['d1'].kp
    bench = Bench(place.machine, place)
    outcome, steps = run(bench, place, small, tmp_path)
    assert outcome.accepted
    assert outcome.reasons == []
    (first, *_), (second, model, kp) = bench.started
    assert (first, second) == ('as_found', 'tuned')
    assert (bench.started[0][1:], model) == ((found_model, found_kp), 9.8)
    assert kp == load_control(place.machine)['d1'].kp != found_kp  # the installed gains are those that ran
    assert bench.moves == [('as_found', 1, 'none'), ('tuned', 1, 'none'), ('inverse', 3, 'inverse')]
    shares = [share for what, share in steps if what == 'tuning']
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_candidates_have_costs_and_the_least_is_recommended(planar, place, small, tmp_path):
    outcome, _ = run(Bench(place.machine, place), place, small, tmp_path)
    tuned = load_control(place.machine)
    for joint, found in outcome.candidates.items():
        assert found[0].name == 'as found'
        assert [each.name for each in found[1:] if each.recommended] == [found[1].name]
        assert found[1].objective == min(each.objective for each in found[1:])
        assert not found[1].beyond
        # the file has six digits
        assert found[1].gains.model_dump()['kp'] == pytest.approx(tuned[joint].kp, rel=1e-5)
    rows = candidate_table(outcome).rows
    assert len(rows) == sum(map(len, outcome.candidates.values()))
    assert [row[-1] for row in rows].count('recommended') == 2


def test_old_files_are_restored_when_the_acceptance_move_fails(planar, place, small, tmp_path):
    before = {path: path.read_bytes() for path in (place.model_file, place.gains_file)}
    bench = Bench(place.machine, place, errors={'tuned': 40 * UM})
    outcome, _ = run(bench, place, small, tmp_path)
    assert not outcome.accepted
    assert outcome.reasons == [f'{j}: error of the acceptance move 40.0 um; allowed 30 um' for j in ('d1', 'd3')]
    assert {path: path.read_bytes() for path in before} == before
    assert [name for name, *_ in bench.started] == ['as_found', 'tuned', 'restored']
    assert bench.started[0][1:] == bench.started[2][1:]
    assert bench.moves[-1] == ('restored', 1, 'none')  # nothing is learned
    assert 'not kept' in verdict(outcome)[0]
    assert [row[3] for row in error_table(planar, outcome).rows] == ['50.0', '50.0']


def cycle_of(*errors):
    """Return the metrics of a cycle with these errors [um], one per joint."""
    return [AxisMetrics(error * UM, 0.0, np.nan, 0.0) for error in errors]


def test_axis_worse_than_found_is_not_accepted(planar):
    gains, models = load_control(planar), load_model(planar)
    reasons = excess(planar, cycle_of(18, 18), cycle_of(26, 19.5), 50 * UM, gains, models)
    assert reasons == ['d1: error of the acceptance move 26.0 um; 18.0 um as found']


def test_error_of_friction_alone_is_accepted(planar):
    """The error after a reversal of 1 N is added to the limit: 28 um on d1."""
    forces = Forces(coulomb=1.0 / planar.thrust_per_volt, slip=10e-6, coupling=1.0)
    gains = load_control(planar)
    models = {joint: model.model_copy(update={'forces': forces}) for joint, model in load_model(planar).items()}
    assert friction_error(gains['d1'], load_model(planar)['d1'], planar.sample_time) == 0.0
    assert friction_error(gains['d1'], models['d1'], planar.sample_time) == pytest.approx(28 * UM, rel=0.05)
    assert excess(planar, cycle_of(60, 60), cycle_of(52, 52), 50 * UM, gains, models) == []
    reasons = excess(planar, cycle_of(60, 60), cycle_of(95, 52), 50 * UM, gains, models)
    assert len(reasons) == 1
    assert 'd1: error of the acceptance move 95.0 um; allowed 7' in reasons[0]
    assert 'um of it for friction' in reasons[0]


def test_fault_under_new_gains_restores_the_old_gains(planar, place, small, tmp_path):
    bench = Bench(place.machine, place, errors={'tuned': PkmError('machine: d1 ran into its upper stop')})
    outcome, _ = run(bench, place, small, tmp_path)
    assert outcome.reasons == ['machine: d1 ran into its upper stop']
    assert bench.started[-1][0] == 'restored'


def test_gains_are_kept_with_a_reason_when_learning_fails(planar, place, small, tmp_path):
    bench = Bench(place.machine, place, errors={'inverse': PkmError('learning law inverse would diverge')})
    outcome, _ = run(bench, place, small, tmp_path)
    assert outcome.accepted
    assert bench.started[-1][0] == 'tuned'
    assert verdict(outcome)[1] == 'The motion was not learned: learning law inverse would diverge'


def test_gains_failing_on_the_measured_response_are_not_applied(planar, place, small, tmp_path):
    def other(model, machine):  # the measured response has twice the fitted gain
        return response_of(model.model_copy(update={'gain': 2 * model.gain}), machine)

    bench = Bench(place.machine, place, responses_of=other)
    outcome, _ = run(bench, place, small, tmp_path)
    assert [name for name, *_ in bench.started] == ['as_found', 'restored']
    assert not outcome.tuned
    assert 'gain margin' in outcome.reasons[0]
    assert 'on the response measured as d1_sweep_0; allowed from 6 dB' in outcome.reasons[0]


def test_old_gains_are_kept_if_no_candidate_is_found(planar, place, small, tmp_path):
    strict = small.limits.nominal.model_copy(update={'gain_margin': 30.0})
    impossible = small.model_copy(update={'limits': small.limits.model_copy(update={'nominal': strict})})
    bench = Bench(place.machine, place)
    outcome, _ = run(bench, place, impossible, tmp_path)
    assert 'none of 320 candidates satisfies all limits' in outcome.reasons[0]
    assert bench.started[-1][0] == 'restored'


def test_lengths_are_calibrated_between_acceptance_and_learning(planar, place, small, tmp_path):
    file = tmp_path / 'planar.yaml'
    file.write_text('calibrated')
    bench = Bench(place.machine, place, calibrated=calibrated(file))
    outcome, _ = run(bench, place, small, tmp_path, calibrate=True)
    assert bench.moves[1:] == [('tuned', 1, 'none'), 'calibrate', ('inverse', 3, 'inverse')]
    assert place.configuration.find('machines', 'planar').read_text() == 'calibrated'
    assert verdict(outcome)[1] == 'The calibrated lengths are in use: misfit 1.02 of the noise.'
    assert end_point_table(planar, outcome).rows[0] == ['x [um]', '8.000', '0.100', '12.000', '0.200', '0.050']
    write_page(tmp_path / 'report.html', planar, outcome, {})
    assert 'End point at rest by laser' in (tmp_path / 'report.html').read_text()


@pytest.mark.parametrize('refusal', [PkmError('misfit 4.30'), calibrated(None, ['misfit 4.30'])])
def test_refused_calibration_keeps_lengths_and_gains(planar, place, small, tmp_path, refusal):
    before = place.configuration.find('machines', 'planar').read_bytes()
    bench = Bench(place.machine, place, calibrated=refusal)
    outcome, _ = run(bench, place, small, tmp_path, calibrate=True)
    assert outcome.accepted
    assert bench.moves[-1] == ('inverse', 3, 'inverse')
    assert place.configuration.find('machines', 'planar').read_bytes() == before
    assert verdict(outcome)[1] == 'The former lengths stay in use: misfit 4.30'


def test_calibration_is_left_out_without_accepted_gains(planar, place, small, tmp_path):
    bench = Bench(place.machine, place, errors={'tuned': 40 * UM}, calibrated=PkmError('never called'))
    outcome, _ = run(bench, place, small, tmp_path, calibrate=True)
    assert 'calibrate' not in bench.moves
    assert outcome.not_calibrated == ''
    assert end_point_table(planar, outcome).rows == []


def test_simulated_bench_calibrates_its_own_specimen(place, tmp_path):
    """The end point is where it is sent, by the truth, and the next moves use the calibrated lengths."""
    machine, seed = place.machine, 4
    motion = load_motion(default_motion(machine))
    bench = SimulatedBench(machine, 'planar', motion, seed=seed, environment='nominal', folder=tmp_path)
    found = bench.calibrate(lambda *_: None)
    assert found.reasons == []
    assert found.verification.better == ('x', 'y')
    place.install_machine(found.machine_file)
    known = load_machine('planar', place.configuration)
    poses = spread_poses(machine, 8, 11)
    before, after = (true_rests(each, poses, seed) - poses for each in (machine, known))
    before, after = (np.abs(errors - errors.mean(axis=0)).max(axis=0) for errors in (before, after))
    assert before[0] > 1e-6
    assert (after < 0.4e-6).all()
    assert bench.move(1, 'none', lambda *_: None)[0][0].max_dynamic_error < 30e-6


def test_report_page_has_the_outcome_and_is_self_contained(planar, place, small, tmp_path):
    outcome, _ = run(Bench(place.machine, place, errors={'tuned': 40 * UM}), place, small, tmp_path)
    write_page(tmp_path / 'report.html', planar, outcome, {'specimen': 3})
    text = (tmp_path / 'report.html').read_text()
    refusal = 'error of the acceptance move 40.0 um; allowed 30 um'
    for expected in (refusal, 'recommended', 'as found', 'a warning', 'specimen'):
        assert expected in text
    assert 'src="data:' in text
    assert 'src="http' not in text


def test_margins_on_a_perfect_measurement_are_those_of_the_model(planar):
    model, gains = load_model(planar)['d1'], load_control(planar)['d1']
    expected = stability_margins(gains, model, planar.sample_time)
    limits = load_tuning().limits.perturbed
    found, reasons = check_measured('d1', gains, model, [response_of(model, planar)], limits, planar.sample_time)
    margins = found['d1_sweep_0']
    assert reasons == []
    # lines of the sweep are 2 Hz apart, those of the model 0.25 Hz
    assert margins.gain_margin == pytest.approx(expected.gain_margin, abs=0.02)
    assert margins.phase_margin == pytest.approx(expected.phase_margin, abs=0.2)
    assert margins.peak_sensitivity == pytest.approx(expected.peak_sensitivity, rel=0.01)


def test_lines_without_coherence_are_left_out(planar):
    model, gains = load_model(planar)['d1'], load_control(planar)['d1']
    spoiled = response_of(model, planar)
    spoiled.plant[100], spoiled.coherence[100] = 1e3 * spoiled.plant[100], 0.3
    limits = load_tuning().limits.perturbed
    assert check_measured('d1', gains, model, [spoiled], limits, planar.sample_time)[1] == []
    spoiled.coherence[100] = 0.9
    assert check_measured('d1', gains, model, [spoiled], limits, planar.sample_time)[1]


def test_measured_perturbed_model_violates_limits_with_numbers(planar):
    model, gains = load_model(planar)['d1'], load_control(planar)['d1']
    measured = [response_of(each, planar, str(number)) for number, each in enumerate(perturbed_models(model, (1.5,)))]
    limits = load_tuning().limits.perturbed
    _, reasons = check_measured('d1', gains, model, measured, limits, planar.sample_time)
    assert any('d1: gain margin 5.' in reason and 'allowed from 6 dB' in reason for reason in reasons)


def test_truth_seed_changes_the_truth_of_the_copy_only(planar, tmp_path):
    place, original = copy_config(planar, tmp_path, 'nominal', 5), planar.configuration
    assert place.machine.configuration == place.configuration == Configuration(tmp_path / 'config')
    assert place.configuration.find('truth', 'planar').read_bytes() != original.find('truth', 'planar').read_bytes()
    for kind in ('model', 'control', 'machines'):
        assert place.configuration.find(kind, 'planar').read_bytes() == original.find(kind, 'planar').read_bytes()


def test_copy_into_a_folder_with_results_is_refused(planar, tmp_path):
    (tmp_path / 'config').mkdir()
    with pytest.raises(PkmError, match='exists; name a folder without the results'):
        copy_config(planar, tmp_path, 'hard')
