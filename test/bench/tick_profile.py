"""
Profile of a composed tick by py-spy.

    .venv/bin/uv pip install --require-hashes -r requirements/bench.txt   # once
    .venv/bin/python test/bench/tick_profile.py --cycles 30 [--keep runs/profile.txt]

py-spy samples the running cell 200 times per second. A sample within the flow of ticks counts for the first matching
part below. The time between two cycles is omitted.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from rich.console import Console
from rich.table import Table

from pkm_nodes.bench.subjects import Subject

_LOOKS = 200  # 1/s
# part: texts of frames, of which one is in the stack
PARTS = {
    'recorder: sort and write': ('RecorderNode', 'Sorter.', 'Cycles.', 'CycleRecording.'),
    'recorder: take': ('_Queues.empty',),
    'state estimator, 1 tick in 20': ('StateEstimatorNode._publish',),
    'state estimator: unpack': ('StateEstimatorNode',),
    'laser': ('LaserNode', 'MachineNode._count'),
    'plant': ('Plant.',),
    'control law': ('RobustController',),
    'controllers: unpack, pack, publish': ('JointControllerNode',),
    'motors: pack, publish': ('LinearMotorNode',),
    'machine: the rest': ('MachineNode',),
    'all that is not the tick, every 50 ms': ('LockstepExecutor._serve',),
    'wait for and take the tick': ('LockstepExecutor._run_flow',),
}


def cell_of(subject):
    """Return the process of the cell started by the process of `subject`."""
    children = Path(f'/proc/{subject.pid}/task/{subject.pid}/children').read_text().split()
    return next(pid for pid in children if b'pkm_nodes/cell' in Path(f'/proc/{pid}/cmdline').read_bytes())


def main():
    """Profile and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--cycles', type=int, default=30)
    parser.add_argument('--keep', type=Path, help='keep the stacks in this file, for a flame graph')
    arguments = parser.parse_args()
    subject = Subject('composed', int(os.environ.get('ROS_DOMAIN_ID', '0')))
    try:
        subject.word()
        with tempfile.TemporaryDirectory() as folder:
            stacks = arguments.keep or Path(folder) / 'stacks'
            options = f'--pid {cell_of(subject)} --duration 100000 --rate {_LOOKS} --format raw --output {stacks}'
            command = [Path(sys.prefix) / 'bin' / 'py-spy', 'record', *options.split()]
            spy = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(2.0)  # until it looks
            subject.ask('turn', arguments.cycles)
            spy.send_signal(signal.SIGINT)
            spy.wait()
            text = stacks.read_text()
        undisturbed = subject.ask('turn', arguments.cycles)
    finally:
        subject.close()

    looks = Counter()
    for line in text.splitlines():
        stack, _, count = line.rpartition(' ')
        if '_run_flow' in stack:
            part = next(part for part, words in PARTS.items() if any(word in stack for word in words))
            looks[part] += int(count)
    total = looks.total()
    table = Table(title=f'{total} looks into the flow; {undisturbed["ticks_per_second"]:.0f} ticks/s without them')
    table.add_column('')
    table.add_column('share \\[%]', justify='right')
    for part, count in looks.most_common():
        table.add_row(part, f'{100 * count / total:.1f}')
    Console().print(table)


if __name__ == '__main__':
    main()
