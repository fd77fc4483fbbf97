"""
The subjects of the bench: one process per subject, so that subjects take turns within one run.

A subject's process prints one line of JSON when it is ready. It then answers every line `[method, argument]` of its
standard input with one line of JSON, until the input ends.
"""

import json
import os
import subprocess
import sys

from pkm_core.errors import PkmError
from pkm_core.machines import load_machine

MACHINE = 'four_dof'
# in the order of the table
SUBJECTS = {
    'floor': '(a) bare floor',
    'bytes': '(a) the same with bytes only',
    'composed': '(b) composed, recorder on',
    'processes': '(c) processes',
    'naive': '(d) processes, naive executor',
    'mujoco': '(e) MuJoCo, mechanism alone',
    'simulation': '(f) simulation without ROS',
    'alone': '(b) composed, no recorder',
    'watched': '(b) composed, recorder and page',
    'pace': '(b) composed, at pace 1.0',
}
FLOORS = ('floor', 'bytes')
# subjects that need their own ROS graph
GRAPHS = (*FLOORS, 'composed', 'processes', 'naive', 'alone', 'watched', 'pace')


class Subject:
    """Handle of a subject's process; a floor needs `readers`, the subscription counts of `composed`."""

    def __init__(self, name, domain, readers=None):
        self.name = name
        environment = os.environ | {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'pkm_nodes.bench.subjects', name, json.dumps(readers)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )

        self._word = None

    @property
    def pid(self):
        """Id of its process."""
        return self._process.pid

    def word(self):
        """Wait until it is ready and return its first line."""
        if self._word is None:
            self._word = self._answer()
        return self._word

    def ask(self, method, argument):
        """Return the result of its `method` with `argument`."""
        self._process.stdin.write(json.dumps([method, argument]) + '\n')
        self._process.stdin.flush()
        return self._answer()

    def close(self):
        """End its process and wait for it."""
        self._process.stdin.close()
        self._process.wait()

    def _answer(self):
        line = self._process.stdout.readline()
        if not line:
            raise PkmError(f'bench: {self.name} has ended with code {self._process.wait()}; its messages are above')
        return json.loads(line)


def _make(name, readers):
    """Return the subject of this process and its first line."""
    if name in FLOORS:
        from pkm_nodes.bench.floor import Floor

        return Floor(len(load_machine(MACHINE).joints), readers, raw=name == 'bytes'), {}
    if name in ('mujoco', 'simulation'):
        from pkm_nodes.bench.no_ros import Mujoco, Simulation

        return {'mujoco': Mujoco, 'simulation': Simulation}[name](MACHINE), {}
    from pkm_nodes.bench.cells import Cell

    arrangement = name if name in ('processes', 'naive') else 'composed'
    pace = 1.0 if name == 'pace' else 0.0
    cell = Cell(MACHINE, arrangement, record=name != 'alone', page=name == 'watched', pace=pace)
    return cell, {'readers': cell.readers(load_machine(MACHINE).joints[0])}


def main():
    """Run the subject that the command line names."""
    answers, sys.stdout = sys.stdout, sys.stderr  # other output is not an answer
    subject, word = _make(sys.argv[1], json.loads(sys.argv[2]))
    try:
        print(json.dumps(word), file=answers, flush=True)
        for line in sys.stdin:
            method, argument = json.loads(line)
            print(json.dumps(getattr(subject, method)(argument)), file=answers, flush=True)
    finally:
        subject.close()


if __name__ == '__main__':
    try:
        main()
    except PkmError as error:
        print(error, file=sys.stderr)
        sys.exit(1)
