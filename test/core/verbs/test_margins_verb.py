"""`pkm margins`: the closed-loop bandwidths of the thesis beside those of the model."""

import json

import pytest
import typer
from typer.testing import CliRunner

from pkm_core.verbs.margins import margins


def run_verb(*options):
    app = typer.Typer()
    app.command()(margins)
    return CliRunner().invoke(app, [str(option) for option in options])


def test_bandwidths_stand_beside_those_of_the_thesis(tmp_path):
    result = run_verb('--machine', 'planar', '--json', tmp_path / 'margins.json')
    assert result.exit_code == 0, result.output
    assert 'Table 7.1' in result.output
    figures = json.loads((tmp_path / 'margins.json').read_text())
    assert figures['thesis']['d1'][:3] == [8.64, 48.4, 75.91]
    assert figures['thesis']['d1'][5] == pytest.approx(figures['axes']['d1']['nominal']['bandwidth'])


def test_machine_without_a_table_in_the_thesis_has_none(tmp_path):
    result = run_verb('--machine', 'xy_stage', '--json', tmp_path / 'margins.json')
    assert result.exit_code == 0, result.output
    assert 'thesis' not in json.loads((tmp_path / 'margins.json').read_text())
