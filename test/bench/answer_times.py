"""
Response time of the controllers to a tick, measured at the machine from its first encoder sample to the last command.

    .venv/bin/python test/bench/answer_times.py --arrangement processes --cycles 30

Real drives do not wait: a response later than one sample time is too late. The recorder runs.
"""

import argparse
import signal
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

from pkm_nodes.nodes.machine import MachineNode
from pkm_nodes.runtime.node import run


class TimedMachine(MachineNode):
    """The machine with time measurement."""

    def __init__(self):
        super().__init__()
        self.seconds = []

    def _publish_samples(self, mode):
        self._sent = perf_counter()
        super()._publish_samples(mode)

    def _advance(self):
        self.seconds.append(perf_counter() - self._sent)
        super()._advance()


def serve(file):
    """Run the machine until interrupted and save its times."""
    machines = []

    def make_nodes():
        machines.append(TimedMachine())
        return [machines[0], *machines[0].parts]

    code = run(make_nodes, [])
    np.save(file, machines[0].seconds)
    return code


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--arrangement', choices=['composed', 'processes'], default='composed')
    parser.add_argument('--cycles', type=int, default=30)
    parser.add_argument('--serve', help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        sys.exit(serve(options.serve))
    with TemporaryDirectory() as folder:
        file = Path(folder) / 'seconds.npy'
        machine = subprocess.Popen([sys.executable, __file__, '--serve', file])
        pkm = Path(sys.prefix) / 'bin' / 'pkm'
        words = ['--without', 'machine', '--arrangement', options.arrangement, '--cycles', options.cycles]
        command = [pkm, 'run', '--law', 'none', *words, '--out', Path(folder) / 'out']
        subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)
        machine.send_signal(signal.SIGINT)
        machine.wait()
        times = 1e6 * np.load(file)
    shares = ' '.join(
        f'{q} %: {value:.0f} us'
        for q, value in zip((50, 99, 99.9, 100), np.percentile(times, (50, 99, 99.9, 100)), strict=True)
    )
    print(
        f'{options.arrangement}, {len(times)} ticks: {shares}; later than 500 us: {100 * np.mean(times > 500.0):.2f} %'
    )


if __name__ == '__main__':
    main()
