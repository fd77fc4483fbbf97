"""
Cost of a composed cell by number of cells on one computer, and by servo rate.

    .venv/bin/python test/bench/scaling.py --figure docs/scaling.png --json runs/scaling.json

Cells run at the same time in namespaces of one ROS domain, one process with its own client per cell. A discovery server
limits discovery to the endpoints each process needs. The rate is set by the machine's sample time: the same motion has
more ticks.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from contextlib import ExitStack, contextmanager
from pathlib import Path

import yaml
from rich.console import Console
from rich.table import Table

from pkm_core.config import Configuration
from pkm_nodes.runtime.discovery import discover_on_this_computer

CELLS = (1, 2, 4, 8, 16)
RATES = (1, 2, 4, 8)  # kHz
MACHINE = 'four_dof'
_SECOND = 1_000_000_000  # ns
_PORT = 11873  # of the discovery server


class Worker:
    """A cell in a namespace with its client, in separate processes."""

    def __init__(self, namespace, machine, control):
        self._process = subprocess.Popen(
            [sys.executable, __file__, '--serve', namespace, machine, control],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, cycles):
        """Start cycles of the cell."""
        self._process.stdin.write(f'{cycles}\n')
        self._process.stdin.flush()

    def answer(self):
        """Return the reply of the cell: the list of its cycles."""
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f'a cell has ended with code {self._process.wait()}')
        return json.loads(line)

    def close(self):
        """End the cell."""
        self._process.stdin.close()
        self._process.wait()


def serve(namespace, machine, control):
    """Act as the client of a cell: each line of the standard input is a number of cycles to run."""
    from pkm_core.machines import load_machine
    from pkm_core.motion.planning import default_motion
    from pkm_nodes.bench.cells import TimedClient
    from pkm_nodes.clients.cell_processes import CellProcesses

    motion, options = default_motion(load_machine(machine)), {'seed': 1, 'environment': 'nominal', 'control': control}
    with (
        tempfile.TemporaryDirectory(prefix='pkm_scaling_') as folder,
        CellProcesses(machine, 'composed', namespace=namespace, folder=folder, **options) as cell,
        TimedClient(namespace) as client,
    ):
        client.wait_until_up(cell.check)
        print(json.dumps([]), flush=True)
        for line in sys.stdin:
            client.execute(motion, int(line), 'none', cell.check, lambda feedback: None)
            print(json.dumps(client.take_cycles(int(line), cell.check)), flush=True)


def ticks_per_second(workers, cycles):
    """Return the ticks per second of all cells while all run `cycles` cycles at the same time."""
    for worker in workers:
        worker.ask(cycles)
    steps = [worker.answer() for worker in workers]
    # from the start of the last cell to the end of the first
    begin = max(cycles_of_cell[0]['started'] for cycles_of_cell in steps)
    end = min(cycles_of_cell[-1]['finished'] for cycles_of_cell in steps)
    ticks = sum(
        cycle['samples'] * _overlap(cycle, begin, end) / (cycle['finished'] - cycle['started'])
        for cycles_of_cell in steps
        for cycle in cycles_of_cell
    )
    return ticks * _SECOND / (end - begin)


def measure(machine, control, counts, turns, cycles):
    """Return {number of cells: ticks/s of all cells}, the best of the turns."""
    speeds = {}
    with ExitStack() as stack:
        workers = []
        for count in counts:
            while len(workers) < count:
                workers.append(Worker(f'/cell{len(workers)}', machine, control))
                stack.callback(workers[-1].close)
                workers[-1].answer()
                ticks_per_second(workers[-1:], 1)  # warm
            speeds[count] = max(ticks_per_second(workers, cycles) for _ in range(turns))
    return speeds


@contextmanager
def discovery_server():
    """Run a discovery server; without it every cell would discover every endpoint of every other cell."""
    command = [Path(sys.prefix) / 'bin' / 'fast-discovery-server', '-i', '0', '-l', '127.0.0.1', '-p', str(_PORT)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    os.environ['ROS_DISCOVERY_SERVER'] = f'127.0.0.1:{_PORT}'
    try:
        yield
    finally:
        server.terminate()
        server.wait()


def _overlap(cycle, begin, end):
    """Return the time [ns] of a cycle between `begin` and `end`."""
    return max(0, min(cycle['finished'], end) - max(cycle['started'], begin))


def at(rate, folder):
    """Return the files of a machine like MACHINE with another servo rate [kHz], and of gains for its delay."""
    text = (Configuration.of_environment().folder / 'machines' / f'{MACHINE}.yaml').read_text()
    line = next(line for line in text.splitlines() if line.startswith('sample_time:'))
    file = Path(folder) / f'{rate}_kHz' / f'{MACHINE}.yaml'
    file.parent.mkdir()
    file.write_text(text.replace(line, f'sample_time: {1e3 / rate:g} us'))
    return str(file), str(_softened(0.8 * min(1.0, rate / 2.0), file.with_name('gains.yaml')))


def _softened(factor, file):
    """Write gains of MACHINE for a loop slower by `factor` than the tuned one to `file`, and return `file`."""
    gains = yaml.safe_load((Configuration.of_environment().folder / 'control' / f'{MACHINE}.yaml').read_text())
    for joint in gains['joints'].values():
        for name, power in (('kp', 1), ('ki', 2), ('kd', 1)):
            value, _, unit = joint[name].partition(' ')
            joint[name] = f'{float(value) * factor**power:.6g} {unit}'
    file.write_text(yaml.safe_dump(gains))
    return file


def draw(cells, rates, file):
    """Draw both tables."""
    import matplotlib as mpl

    mpl.use('Agg')
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout='constrained')
    left.plot(cells.keys(), cells.values(), 'o-', label='all cells')
    left.plot(cells.keys(), [speed / count for count, speed in cells.items()], 's--', label='each')
    left.set(xlabel='cells on one computer', ylabel='ticks per second', xscale='log', yscale='log')
    left.set_xticks(CELLS, [str(count) for count in CELLS])
    left.legend()
    right.plot(rates.keys(), [speed / (1e3 * rate) for rate, speed in rates.items()], 'o-')
    right.axhline(1.0, color='grey', linewidth=0.8)
    right.set(xlabel='servo rate [kHz]', ylabel='x real time', xscale='log', yscale='log')
    right.set_xticks(RATES, [str(rate) for rate in RATES])
    for axes in (left, right):
        axes.minorticks_off()
        axes.grid(which='both', alpha=0.3)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=120)


def main():
    """Measure, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--cycles', type=int, default=4, help='a cell and measurement')
    parser.add_argument('--turns', type=int, default=3, help='the best of so many counts')
    parser.add_argument('--figure', type=Path)
    parser.add_argument('--json', type=Path)
    arguments = parser.parse_args()
    discover_on_this_computer()
    with tempfile.TemporaryDirectory() as folder, discovery_server():
        cells = measure(MACHINE, 'robust', CELLS, arguments.turns, arguments.cycles)
        rates = {rate: measure(*at(rate, folder), [1], arguments.turns, arguments.cycles)[1] for rate in RATES}
    table = Table(title=f'composed cells, best of {arguments.turns}')
    for heading in ('cells', 'ticks/s of all', 'of each', '', 'servo rate [kHz]', 'ticks/s', 'x real time'):
        table.add_column(heading.replace('[', r'\['), justify='right')
    for row in range(max(len(CELLS), len(RATES))):
        left = right = ('', '', '')
        if row < len(CELLS):
            count = CELLS[row]
            left = (f'{count}', f'{cells[count]:.0f}', f'{cells[count] / count:.0f}')
        if row < len(RATES):
            rate = RATES[row]
            right = (f'{rate}', f'{rates[rate]:.0f}', f'{rates[rate] / (1e3 * rate):.2f}')
        table.add_row(*left, '', *right)
    Console().print(table)
    if arguments.figure:
        draw(cells, rates, arguments.figure)
    if arguments.json:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        arguments.json.write_text(json.dumps({'cells': cells, 'rates_khz': rates}, indent=2) + '\n')


if __name__ == '__main__':
    if sys.argv[1:2] == ['--serve']:
        serve(*sys.argv[2:])
    else:
        main()
