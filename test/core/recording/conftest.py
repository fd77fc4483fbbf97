"""Cells whose messages arrive in order, or late."""

import pytest

from pkm_core.recording import cycles
from support.recorded_cell import Cell, SlowCell


@pytest.fixture
def cell(tmp_path):
    return Cell(tmp_path)


@pytest.fixture
def slow_cell(tmp_path):
    return SlowCell(tmp_path)


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(cycles, 'STRAGGLERS', -1.0)
