"""SIGINT and SIGTERM at any moment: exit code, output, bags."""

import json
import random
import signal
import subprocess
import sys
from pathlib import Path
from time import monotonic, sleep

import pytest

from pkm_core.bag.reader import read_topics
from pkm_core.errors import PkmError
from pkm_nodes.clients.cell_client import CellClient
from pkm_nodes.clients.cell_processes import CellProcesses
from support.processes import without_reports

DOMAIN = 111
NODES, BIN = Path(sys.prefix) / 'lib/pkm_nodes', Path(sys.prefix) / 'bin'
ROS2 = Path(__file__).resolve().parents[2] / 'bringup_scripts/ros2'


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


def test_signals_while_programs_start_print_nothing(processes):
    """Six programs, each interrupted at a random moment of its start; test/campaign has more of them."""
    rng, started, due = random.Random(1), [], monotonic()
    commands = [[NODES / 'machine'], [NODES / 'cell'], [BIN / 'pkm', 'run', '--out', processes.folder / 'run']]
    commands += [
        [ROS2, 'topic', 'list'],
        [ROS2, 'run', 'pkm_nodes', 'recorder'],
        [BIN / 'pkm', 'page', '--port', '8131'],
    ]
    for number, command in enumerate(commands):
        sent, delay = rng.choice((signal.SIGINT, signal.SIGTERM)), rng.uniform(0.0, 2.5)
        started.append((due + delay, sent, processes.start(*command, log=f'{number}.log'), number))
    for at, sent, process, _ in sorted(started, key=lambda each: each[0]):
        sleep(max(0.0, at - monotonic()))
        process.send_signal(sent)
    for _, sent, process, number in started:
        code, printed = process.wait(timeout=30), without_reports((processes.folder / f'{number}.log').read_text())
        # 0: a node that was up, or a program at its end
        assert code in (0, 128 + sent, -sent), (commands[number], code, printed)
        assert not any(word in printed for word in ('Traceback', 'Error', 'Exception', 'invalid')), printed


def test_interrupted_run_stops_its_cell_and_keeps_bags(processes):
    run = processes.start(BIN / 'pkm', 'run', '--cycles', '200', '--law', 'none', '--out', processes.folder / 'run')
    bags = processes.folder / 'run/bags'
    deadline = monotonic() + 90.0
    while not list(bags.glob('*_0002_*')):  # a second bag is begun: the first one is closed
        assert run.poll() is None, (processes.folder / 'log').read_text()
        assert monotonic() < deadline
        sleep(0.05)
    run.send_signal(signal.SIGINT)
    assert run.wait(timeout=30) == 130
    assert 'Traceback' not in (processes.folder / 'log').read_text()
    assert 'Traceback' not in (processes.folder / 'run/log/cell.log').read_text()
    for bag in bags.iterdir():
        assert read_topics(bag, ['/pkm/d1/encoder'])['/pkm/d1/encoder']
    results = json.loads((processes.folder / 'run/results.json').read_text())
    kept = [cycle['bag'] for cycle in results['cycles']]
    assert kept == sorted(bag.name for bag in bags.iterdir())[: len(kept)], 'whole cycles only'
    assert f'interrupted after {len(kept)} of 200 cycles; these are kept\n' in (processes.folder / 'log').read_text()
    mark = f'folder:={processes.folder}'
    assert mark not in subprocess.run(['ps', '-ww', '-eo', 'args'], capture_output=True, text=True, check=True).stdout
