"""The bench of growing cost, with as little as makes sense; the figures are not judged here."""

import sys
from pathlib import Path

import pytest

from pkm_core.machines import load_machine

sys.path.append(str(Path(__file__).parent))
from scaling import MACHINE, discovery_server, machine_at, measure


def test_rate_is_that_of_the_machine_file_and_nothing_else_differs(tmp_path):
    fast, nominal = load_machine(machine_at(8, tmp_path)), load_machine(MACHINE)
    assert fast.sample_time == pytest.approx(125e-6)
    assert fast.name == nominal.name
    assert fast.config.geometry == nominal.config.geometry


@pytest.mark.slow
def test_two_cells_in_one_domain_run_at_once(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '138')
    monkeypatch.setenv('ROS_DISCOVERY_SERVER', '')  # set for good by the server's block
    with discovery_server():
        speeds = measure(MACHINE, [1, 2], turns=1, cycles=1)
    assert all(speed > 0 for speed in speeds.values())
