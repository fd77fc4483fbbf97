"""The scaling bench with the smallest useful settings; its figures are not checked."""

import sys
from pathlib import Path

import pytest

from pkm_core.control.margins import stability_margins
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.machines import load_machine

sys.path.append(str(Path(__file__).parent))
from scaling import MACHINE, RATES, at, discovery_server, measure


def test_machine_file_of_another_rate_differs_in_the_rate_only(tmp_path):
    fast, nominal = load_machine(at(8, tmp_path)[0]), load_machine(MACHINE)
    assert fast.sample_time == pytest.approx(125e-6)
    assert fast.name == nominal.name
    assert fast.config.geometry == nominal.config.geometry


@pytest.mark.parametrize('rate', RATES)
def test_gains_for_every_rate_have_the_required_margins(rate, tmp_path):
    machine_file, gains_file = at(rate, tmp_path)
    machine = load_machine(machine_file)
    models = load_model(machine)
    for joint, law in load_control(machine, gains_file).items():
        margins = stability_margins(law, models[joint], machine.sample_time)
        assert margins.gain_margin > 6.0
        assert margins.phase_margin > 30.0


@pytest.mark.slow
def test_two_cells_in_one_domain_run_at_once(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '138')
    monkeypatch.setenv('ROS_DISCOVERY_SERVER', '')  # restored after the server's block has set it
    with discovery_server():
        speeds = measure(MACHINE, 'robust', [1, 2], turns=1, cycles=1)
    assert all(speed > 0 for speed in speeds.values())
