"""Report: figures computed from the bags, with those of the thesis, on a self-contained page."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.errors import PkmError
from pkm_core.motion.metrics import axis_metrics
from pkm_core.reporting.facts import parameters_table
from pkm_core.reporting.histories import ARM, end_point_histories, joint_histories, laser_histories
from pkm_core.reporting.report import write_report
from pkm_core.reporting.runs import read_run, read_runs
from pkm_core.reporting.spectrum import amplitude_spectrum
from pkm_core.reporting.summary import axis_figures
from pkm_core.reporting.tool import laser_step, path_table, tool_figures, tool_table
from pkm_core.thesis.results import END_POINT, JOINT_SPACE
from pkm_core.verbs.report import report as verb

FIGURES = {'error_over_cycles', 'tracking', 'pose_tracking', 'error', 'spectrum', 'voltage', 'settling', 'end_point'}


@pytest.fixture(scope='module')
def make_run(start_recording_in, make_cycle):
    """Return a function that writes a run of two cycles in the format of `pkm run`; the error falls to a tenth."""

    def make(folder, machine='four_dof', laser=False):
        for number, amplitude in ((1, 20e-6), (2, 2e-6)):
            cycle = make_cycle(machine, amplitude)
            recording = start_recording_in(folder / 'bags', cycle, number, first_tick=400 * number, laser=laser)
            recording.ticks()
            if laser:
                measure(recording)
            recording.close()
        ran = {'machine': machine, 'law': 'fourier', 'seed': 7, 'messages': {}, 'cycles': []}
        (folder / 'results.json').write_text(json.dumps(ran))
        return folder

    return make


def measure(recording):
    """Record a laser sample every 0.8 ms: the reference pose, less 3 um (phi: 3 um on `ARM`) from the first move."""
    poses = recording.cycle.poses
    for number in range(250):
        time = number * 0.8e-3
        pose = [np.interp(time, np.arange(400) * 5e-4, column) for column in poses.position.T]
        moved = time >= poses.move_starts[0] * 5e-4
        recording.laser(time, pose - poses.position[0] + 7e-6 - moved * np.array([3e-6, 3e-6, 3e-6, 3e-6 / ARM]))


class Page(HTMLParser):
    """Tags, links and table cells of a page."""

    def __init__(self, path):
        super().__init__()
        self.tags, self.links, self.cells, self._row = [], [], [], None
        self.feed(path.read_text(encoding='utf-8'))

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.links += [value for key, value in attributes if key in ('src', 'href')]
        if tag == 'tr':
            self.cells.append([])
        elif tag in ('td', 'th'):
            self.cells[-1].append('')
            self._row = self.cells[-1]

    def handle_endtag(self, tag):
        if tag in ('td', 'th'):
            self._row = None

    def handle_data(self, data):
        if self._row is not None:
            self._row[-1] += data


@pytest.fixture(scope='module')
def report(make_run, start_recording_in, tmp_path_factory):
    """Return (folder, runs, figures) of a report on two runs; the first has a laser, a cut bag and a killed one."""
    folder = tmp_path_factory.mktemp('report')
    first, second = make_run(folder / 'first', laser=True), make_run(folder / 'second', 'planar')
    cut = start_recording_in(first / 'bags', number=3)
    cut.ticks(100)
    cut.close()
    start_recording_in(first / 'bags', number=4)
    return folder, *write_report([first, second], folder)


@pytest.fixture(scope='module')
def page(report):
    return Page(report[0] / 'report.html')


def test_page_is_self_contained(report, page):
    assert not {'script', 'link', 'iframe', 'object'} & set(page.tags)
    assert all(link.startswith(('data:image/svg+xml;base64,', '#')) for link in page.links)
    assert page.tags.count('img') == len(FIGURES)
    text = (report[0] / 'report.html').read_text()
    assert not re.search(r'url\(|@import', text)
    assert len(text) < 3e6, 'size fit for e-mail'


def test_every_figure_is_also_written_as_png(report):
    pngs = {path.stem: path for path in report[0].glob('*.png')}
    assert set(pngs) == FIGURES
    assert all(path.read_bytes().startswith(b'\x89PNG') for path in pngs.values())


def test_figures_are_computed_from_the_bags(report, make_cycle):
    _, _, figures = report
    cycle = make_cycle('four_dof', 20e-6)
    moves = (cycle.joints.move_starts, cycle.joints.move_ends, 5e-4)
    ours = dict(zip(cycle.machine.joints, (axis_figures(axis_metrics(e, *moves)) for e in cycle.error.T), strict=True))
    first = figures['runs'][0]
    assert first['joints'][1] == ours
    assert first['cycles'][0] == {'cycle': 1, 'axes': ours, 'tool': first['cycles'][0]['tool']}


def test_tables_compare_two_runs_and_the_thesis(page, make_cycle):
    ours = [f'{run}, cycle {cycle}' for run in ('first', 'second') for cycle in (1, 2)]
    theirs = ['thesis, computed torque', 'thesis, robust', 'thesis, robust learning']
    assert ['', 'axis', *ours, *theirs] in page.cells
    assert ['', 'axis', *ours, 'thesis, single stages', *theirs] in page.cells
    errors = [f'{1e6 * np.abs(make_cycle("four_dof", a).error[:, 3]).max():.1f}' for a in (20e-6, 2e-6)]
    assert ['', 'd7', *errors, '', '', '140.2', '47.0', '5.6'] in page.cells, 'the planar machine has no d7'
    assert ['machine', 'four_dof', 'planar'] in page.cells
    assert ['seed', '7', '7'] in page.cells


def test_page_begins_with_the_outcome_and_one_table(report, page):
    """The sentence has the figures of the table; everything else follows the second heading."""
    text = (report[0] / 'report.html').read_text()
    begin = text[text.index('</h1>') : text.index('<h2')]
    _, _, figures = report
    first, last = (figures['runs'][0]['joints'][cycle] for cycle in (1, 2))
    before, after = (max(axes.values(), key=lambda axis: axis['max_dynamic_error_um']) for axes in (first, last))
    numbers = [each['max_dynamic_error_um'] for each in (before, after)]
    assert f'went from {numbers[0]:.1f} um (d7) in cycle 1 to {numbers[1]:.1f} um (d7) in cycle 2, 10.0 times' in begin
    assert begin.count('<table>') == 1
    d7 = next(row for row in page.cells if row[0] == 'd7')
    settled = last['d7']['settling_5um_ms']
    assert d7 == ['d7', f'{numbers[0]:.1f}', f'{numbers[1]:.1f}', f'{settled:.1f}', '', '', '', '5.6']


def test_settings_have_readable_names_and_long_tables_are_folded(report, page, start_recording_in, tmp_path):
    text = (report[0] / 'report.html').read_text()
    assert text.count('<details>') == page.tags.count('summary') == 2, 'the messages of each run'
    assert ['learning law', 'fourier', 'fourier'] in page.cells
    facts = {'machine': 'four_dof', 'parameters': '{"machine": {"seed": 1, "pace": 0.5}, "laser": {"session": ""}}'}
    recording = start_recording_in(tmp_path / 'bags', metadata=facts)
    recording.ticks()
    recording.close()
    write_report([tmp_path], tmp_path / 'out')
    cells = Page(tmp_path / 'out' / 'report.html').cells
    assert ['machine', 'seed', '1'] in cells
    assert ['', 'pace', '0.5'] in cells
    assert ['laser', 'session', '-'] in cells
    assert not any(row[:1] == ['parameters'] for row in cells)


@pytest.mark.parametrize('parameters', ['{', '[1]', '"text"', '{"machine": 3}', ''])
def test_odd_parameters_of_a_bag_are_left_out(make_run, tmp_path, parameters):
    run = read_run(make_run(tmp_path))
    assert parameters_table(replace(run, facts=run.facts | {'parameters': parameters})) is None


def test_page_follows_dark_scheme_and_narrow_windows(report):
    text = (report[0] / 'report.html').read_text()
    assert '@media (prefers-color-scheme: dark)' in text
    assert '@media (max-width: 600px)' in text
    assert '<meta name="viewport" content="width=device-width' in text


def test_incomplete_bag_is_omitted_with_a_remark(report):
    folder, runs, figures = report
    assert [record.cycle for record in runs[0].records] == [1, 2]
    ends, killed = figures['runs'][0]['remarks']
    assert 'short_0003: ends after 100 of 400 ticks' in ends
    assert 'short_0004: has no metadata.yaml' in killed
    assert 'short_0003: ends after 100 of 400 ticks' in (folder / 'report.html').read_text()


def test_laser_figures_use_the_clock_of_the_laser(report, page):
    _, runs, figures = report
    for axis in figures['runs'][0]['laser'][1].values():
        assert axis['steady_state_error_um'] == pytest.approx(3.0, abs=1e-6), 'independent of its datum'
        assert axis['settling_5um_ms'] == 0.0
        assert axis['settling_1um_ms'] is None
    histories = laser_histories(runs[0].records[1])
    assert histories.sample_time == pytest.approx(0.8e-3)
    assert histories.move_ends.tolist() == [63, 188], 'ends of the profiles at 50 and 150 ms'
    assert any(row[1:3] == ['x', 'never'] for row in page.cells), 'within 1 um'
    assert 'laser' not in figures['runs'][1]


def test_tool_is_judged_during_the_moves_and_at_rest(make_run, tmp_path, capsys):
    """The laser shows 3 um less than the reference from the first move on, phi on 50 mm."""
    run = read_run(make_run(tmp_path / 'run', laser=True))
    figures = tool_figures(run.records[0])
    assert tuple(figures) == ('x', 'y', 'z', 'phi')
    for values in figures.values():
        assert values['moves_rms_um'] == pytest.approx(3.0, abs=0.01)
        assert values['moves_largest_um'] == pytest.approx(3.0, abs=0.01)
        assert 0 < values['rests_rms_um'] < values['rests_largest_um'] == pytest.approx(3.0, abs=0.01)
    verb(tmp_path / 'run', compare=None, out=tmp_path / 'out', json_file=None)
    assert 'tool by laser against the commanded path, cycle 1 -> 2' in capsys.readouterr().out
    assert 'Tool by laser against the commanded path, cycle 1 -&gt; 2' in (tmp_path / 'out' / 'report.html').read_text()


def test_step_of_the_laser_is_found_in_its_readings(make_run, tmp_path):
    record = read_run(make_run(tmp_path, laser=True)).records[0]
    rounded = replace(record, laser=0.91e-6 * np.round(record.laser / 0.91e-6) / [1, 1, 1, ARM])
    assert laser_step([rounded]) == pytest.approx(0.91e-6)


def test_run_without_a_laser_has_no_table_of_the_tool(make_run, tmp_path):
    run = read_run(make_run(tmp_path))
    assert tool_figures(run.records[0]) == {}
    assert tool_table(run.records) is None
    assert path_table([run]) is None


def test_verb_writes_a_reproducible_page(make_run, tmp_path, capsys):
    """By default into the folder of the run; a second page has the same bytes."""
    folder = make_run(tmp_path / 'run', 'planar')
    verb(folder, compare=None, out=None, json_file=tmp_path / 'figures.json')
    assert str(folder / 'report' / 'report.html') in capsys.readouterr().out.replace('\n', '')
    _, figures = write_report([folder], tmp_path / 'again')
    assert json.loads((tmp_path / 'figures.json').read_text()) == json.loads(json.dumps(figures))
    assert (folder / 'report' / 'report.html').read_bytes() == (tmp_path / 'again' / 'report.html').read_bytes()


def test_runs_with_equal_folder_names_are_named_by_path(make_run, tmp_path):
    folders = [make_run(tmp_path / name / 'run', 'planar') for name in 'ab']
    assert [run.name for run in read_runs(folders)] == [str(folder) for folder in folders]


def test_end_point_is_the_forward_kinematics_of_the_encoders(make_run, tmp_path):
    run = read_run(make_run(tmp_path))
    histories = end_point_histories(run.records[0], run.machine)
    assert histories.names == ('x', 'y', 'z', 'phi')
    assert np.array_equal(histories.measured, run.machine.forward(run.records[0].position))
    # the Jacobian maps joint errors to the pose to first order; 80 um over 100 mm give second-order terms of 1e-3
    jacobian = run.machine.jacobian(run.records[0].position)
    expected = np.einsum('kij,kj->ki', jacobian, run.records[0].error) * [1.0, 1.0, 1.0, ARM]
    assert histories.error == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


def test_metrics_of_a_move_end_with_its_rest(make_run, tmp_path):
    record = read_run(make_run(tmp_path)).records[0]
    for axis, metrics in joint_histories(record).metrics_of_moves().items():
        error = record.error[:, record.joints.index(axis)]
        second = record.move_starts[1]
        assert metrics[0] == axis_metrics(error[:second], record.move_starts[:1], record.move_ends[:1], 5e-4)
        assert metrics[1] == axis_metrics(error[second:], [0], record.move_ends[1:] - second, 5e-4)


def test_facts_equal_in_all_bags_are_facts_of_the_run(start_recording_in, tmp_path):
    for number in (1, 2):
        facts = {'machine': 'four_dof', 'git_revision': '0123abc', 'cycle': str(number)}
        recording = start_recording_in(tmp_path, number=number, metadata=facts)
        recording.ticks()
        recording.close()
    assert read_run(tmp_path).facts == {'machine': 'four_dof', 'git_revision': '0123abc'}


def test_folder_without_a_run_is_refused(make_run, start_recording_in, tmp_path):
    with pytest.raises(PkmError, match='nowhere: does not exist; expected the output of pkm run'):
        read_run(tmp_path / 'nowhere')
    with pytest.raises(PkmError, match='is no folder; expected the output of pkm run'):
        read_run(__file__)
    with pytest.raises(PkmError, match='no complete cycle in 0 bags'):
        read_run(tmp_path)
    folder = make_run(tmp_path / 'run')
    (folder / 'results.json').write_text('{')
    with pytest.raises(PkmError, match=r'results\.json: cannot be read as the results of a run'):
        read_run(folder)
    (folder / 'results.json').unlink()
    with pytest.raises(PkmError, match=r'neither results\.json nor the bags name the machine'):
        read_run(folder)
    recording = start_recording_in(folder / 'bags', number=3, motion='other')
    recording.ticks()
    recording.close()
    with pytest.raises(PkmError, match=r"has cycles of several motions, \['other', 'short'\]"):
        read_run(folder)


def test_unwritable_report_folder_is_refused(make_run, tmp_path):
    with pytest.raises(PkmError, match='/proc/nowhere: cannot be written'):
        write_report([make_run(tmp_path)], '/proc/nowhere')


def test_spectrum_has_the_power_and_peak_of_the_error(write_bag, make_cycle):
    record = read_cycle(write_bag(make_cycle(offset=1e-6)))
    frequency, amplitude = amplitude_spectrum(record.error, record.sample_time)
    assert frequency[-1] == 1000.0
    # Parseval: the amplitudes hold the mean square of the error
    power = amplitude**2 / 2
    power[[0, -1]] *= 2
    assert power.sum(axis=0) == pytest.approx(np.mean(record.error**2, axis=0))
    assert abs(frequency[amplitude[1:, 0].argmax() + 1] - 80.0) < 10.0


@pytest.mark.parametrize('table', [*JOINT_SPACE.values(), *END_POINT.values()])
def test_thesis_table_has_a_cell_for_every_column(table):
    axes = {quantity: list(values) for quantity, values in table.values.items()}
    assert len(set(map(tuple, axes.values()))) == 1
    assert all(len(row) == len(table.columns) for values in table.values.values() for row in values.values())
