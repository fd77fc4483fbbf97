"""
How much the recorder slows a composed cell at full speed: cells with and without one, in turns.

Run `.venv/bin/python test/bench/bench_recorder.py`. Ticks/s mean something on a machine that does nothing else; the
processor time the cell needs for a tick always does. Without a recorder nobody listens to twist and markers either.
"""

import argparse
import os
import tempfile
from pathlib import Path
from statistics import median


def processor_time(pid):
    """Return the processor time [s] a process has had."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def turn(cycles, *, record):
    """Return ticks/s and the cell's processor time a tick [us]."""
    from pkm_nodes.client import CellClient
    from pkm_nodes.processes import CellProcesses

    with (
        tempfile.TemporaryDirectory() as folder,
        CellProcesses('four_dof', 'composed', seed=1, environment='nominal', folder=folder, record=record) as cell,
        CellClient() as client,
    ):

        def drive(cycles):
            return client.execute('four_dof_70ms', cycles, 'fourier_pid', cell.check, lambda _: None, record=record)

        client.wait_until_up(cell.check)
        log = drive(2)  # warm
        log.bags.clear()
        ticks, seconds = log.ticks, log.seconds_in_cycles
        before = processor_time(cell.processes['cell'].pid)
        drive(cycles)
        ticks, seconds = log.ticks - ticks, log.seconds_in_cycles - seconds
        return ticks / seconds, 1e6 * (processor_time(cell.processes['cell'].pid) - before) / ticks


def main():
    """Print both figures of every turn and the medians of their ratios."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('--turns', type=int, default=6)
    options.add_argument('--cycles', type=int, default=10, help='a turn')
    options = options.parse_args()
    os.environ |= {'ROS_DOMAIN_ID': '119', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    ratios = []
    for number in range(options.turns):
        pair = {}
        for record in (False, True) if number % 2 else (True, False):
            pair[record] = turn(options.cycles, record=record)
        ratios.append([a / b for a, b in zip(pair[True], pair[False], strict=True)])
        print(
            f'without: {pair[False][0]:5.0f} ticks/s, {pair[False][1]:4.0f} us a tick; '
            f'with: {pair[True][0]:5.0f} ticks/s, {pair[True][1]:4.0f} us a tick; '
            f'ratios {ratios[-1][0]:.3f}, {ratios[-1][1]:.3f}',
            flush=True,
        )
    speed, time = (median(column) for column in zip(*ratios, strict=True))
    print(f'medians: ticks/s x {speed:.3f}, processor time a tick x {time:.3f}')


if __name__ == '__main__':
    main()
