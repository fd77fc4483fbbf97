"""Ctrl-C in the middle of a motion: exit code and bags."""

import signal
from time import sleep

import pytest

from pkm_core.bag.reader import read_topics
from pkm_core.errors import PkmError
from pkm_nodes.clients.cell_client import CellClient
from pkm_nodes.clients.cell_processes import CellProcesses

DOMAIN = 111


def test_interrupted_cell_ends_with_code_0_and_readable_bags(tmp_path, monkeypatch):
    # a KeyboardInterrupt once ended the recorder within a callback: with luck between two bags, else without
    monkeypatch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    cell = CellProcesses('four_dof', 'composed', seed=1, environment='nominal', folder=tmp_path)
    with cell, CellClient() as client:
        client.wait_until_up(cell.check)
        process = cell.processes['cell']

        def interrupt_the_third_cycle(feedback):
            if feedback.cycle == 2:
                sleep(0.1)  # within the third cycle
                process.send_signal(signal.SIGINT)
                process.wait(timeout=30)

        with pytest.raises(PkmError, match='cell has ended with code 0'):
            client.execute('four_dof_70ms', 100, 'none', cell.check, interrupt_the_third_cycle)
    assert 'Traceback' not in (tmp_path / 'log' / 'cell.log').read_text()
    bags = sorted((tmp_path / 'bags').iterdir())
    assert len(bags) >= 2
    for bag in bags:
        assert read_topics(bag, ['/pkm/d1/encoder'])['/pkm/d1/encoder']
