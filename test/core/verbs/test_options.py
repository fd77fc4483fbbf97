"""Options of the verbs: one name, one type and one help text for one meaning."""

import json
from importlib.metadata import entry_points

import pytest
import typer
from typer.testing import CliRunner

from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.verbs.options import robust_gains, run_folder, write_figures

# --out of `pkm tune` is required, that of `report` is relative to its argument, that of `parameters` is a file;
# --arrangement has the simulation where there is one; the other options have their own meaning in each verb
OWN = {
    *('--out', '--arrangement', '--samples', '--tolerance', '--cycles', '--law', '--environment', '--without'),
    *('--poses', '--band', '--bag', '--help'),
}


def options():
    """Yield (verb, option, help) of every option of every verb."""
    for entry in entry_points(group='pkm.verbs'):
        app = typer.Typer(add_completion=False)
        app.command()(entry.load())
        for parameter in typer.main.get_command(app).params:
            for name in parameter.opts:
                yield entry.name, name, parameter.help


def test_one_option_has_one_help_text():
    texts = {}
    for verb, name, text in options():
        if name.startswith('--') and name not in OWN:
            texts.setdefault(name, {}).setdefault(text, []).append(verb)
    assert {name: verbs for name, verbs in texts.items() if len(verbs) > 1} == {}


@pytest.mark.parametrize('old', ['--control', '--scheduler'])
def test_former_names_of_options_are_gone(old):
    assert [verb for verb, name, _ in options() if name == old] == []


def verbs_with(option):
    """Return {name: typer app} of the verbs with `option`."""
    named = {verb for verb, name, _ in options() if name == option}
    apps = {}
    for entry in entry_points(group='pkm.verbs'):
        if entry.name in named:
            apps[entry.name] = typer.Typer(add_completion=False)
            apps[entry.name].command()(entry.load())
    return apps


@pytest.mark.parametrize('option', ['--json', '--save-learned'])
def test_place_that_cannot_be_written_is_found_before_the_run(option):
    apps = verbs_with(option)
    assert 'run' in apps
    for verb, app in apps.items():
        found = CliRunner().invoke(app, [option, '/proc/nowhere'])
        assert str(found.exception).startswith('/proc/nowhere: cannot be written'), verb


@pytest.mark.parametrize('option', ['--json', '--save-learned'])
def test_existing_file_is_replaced_only_with_overwrite(option, tmp_path):
    file = tmp_path / 'notes'
    file.write_text('mine')
    for verb, app in verbs_with(option).items():
        found = CliRunner().invoke(app, [option, str(file)])
        assert str(found.exception).startswith(f'{file}: exists; expected a new name. With --overwrite'), verb
    assert file.read_text() == 'mine'
    assert set(verbs_with('--json')) == set(verbs_with('--overwrite'))


def test_folder_with_files_is_written_only_with_overwrite(tmp_path):
    (tmp_path / 'notes').write_text('mine')
    others = {'parameters'}  # one generated page; `report` is in test_report.py
    for verb, app in verbs_with('--out').items():
        needed = {'report': [str(tmp_path)], 'experiment': ['planar'], 'identify-bag': ['bag']}.get(verb, [])
        found = CliRunner().invoke(app, [*needed, '--out', str(tmp_path)])
        refused = str(found.exception).startswith(f'--out: {tmp_path} has files; expected a new name. With --overwrite')
        assert refused or verb in others, (verb, found.output, found.exception)


def test_overwrite_removes_bags_and_results_of_a_run_only(tmp_path):
    for name in ('bags/one/one_0.mcap', 'bags/mine/notes', 'results.json', 'config/mine.yaml'):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text('')
    run_folder(tmp_path, 'planar')
    left = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob('*') if path.is_file())
    assert left == ['bags/mine/notes', 'config/mine.yaml']


def test_file_of_others_is_not_chosen_for_learned_feedforward(tmp_path):
    (tmp_path / 'notes.npz').write_text('mine')
    words = ['--overwrite', '--save-learned', str(tmp_path / 'notes.npz')]
    found = CliRunner().invoke(verbs_with('--save-learned')['run'], words)
    assert 'is not a file of learned feedforward' in str(found.exception)
    assert (tmp_path / 'notes.npz').read_text() == 'mine'


def test_computed_torque_gains_are_refused_for_robust_control():
    with pytest.raises(PkmError, match=r"^--controller: 'computed_torque' is for computed_torque; expected gains of"):
        robust_gains(load_machine('planar'), 'computed_torque')


def test_folder_of_a_run_is_new_and_named_after_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = run_folder(None, 'planar')
    assert folder.parent.name == 'runs'
    assert folder.name.endswith('_planar')
    assert folder.is_dir()


def test_figures_are_written_only_to_a_named_file(tmp_path):
    write_figures(None, {'a': 1})
    write_figures(tmp_path / 'a.json', {'a': 1})
    assert json.loads((tmp_path / 'a.json').read_text()) == {'a': 1}
