"""`pkm run` when a process of the cell is killed or stopped in a cycle: table, lost ticks, name of the process."""

import os
import re
import signal
import sys
from pathlib import Path
from time import monotonic, sleep

import pytest

from pkm_nodes.clients.own_bags import losses_in

DOMAIN = 130
PKM = Path(sys.prefix) / 'bin' / 'pkm'
PATIENCE = 180.0  # [s, wall] for the start of a cell on a loaded computer


@pytest.mark.parametrize(
    ('node', 'sent', 'reason'),
    [
        ('machine', signal.SIGKILL, 'machine has ended with code -9'),
        ('identification', signal.SIGSTOP, r'identification \(process \d+\) is stopped, by SIGSTOP or a debugger'),
    ],
)
def test_run_without_a_node_fails_and_keeps_its_table(processes, node, sent, reason):
    out = processes.folder / 'out'
    command = [PKM, 'run', '--arrangement', 'processes', '--cycles', 500, '--law', 'none', '--out', out]
    client = processes.start(*command, log='log')
    deadline = monotonic() + PATIENCE
    while len(list(out.glob('bags/*'))) < 3 and client.poll() is None and monotonic() < deadline:
        sleep(0.05)
    assert client.poll() is None
    [pid] = [pid for pid in children_of(client.pid) if f'/{node}' in Path(f'/proc/{pid}/cmdline').read_text()]
    os.kill(pid, sent)
    assert client.wait(timeout=60.0) == 1
    said = (processes.folder / 'log').read_text()
    assert re.search(reason, said)
    assert re.search(r'│ d1 +│ +1 │', said), 'figures of the whole cycles'
    losses = losses_in(out / 'bags')
    assert all(line in said for line in losses)
    assert not losses or node == 'machine'


def children_of(parent):
    return [int(pid) for pid in Path(f'/proc/{parent}/task/{parent}/children').read_text().split()]
