"""What an attack works in: a folder, a ROS domain, and processes that are found and ended by a mark of their own."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep
from uuid import uuid4

from campaign.attacks import FellShortError

BIN = Path(sys.prefix) / 'bin'
TESTS = Path(__file__).resolve().parents[1]
EXECUTABLES = Path(sys.prefix) / 'lib' / 'pkm_nodes'
DOMAIN = 140
ENCODERS = [f'/pkm/{joint}/encoder' for joint in ('d1', 'd3', 'd5', 'd7')]
# [s, wall] from a fault to the answer that every client must have
ANSWER = 25.0
# [s, wall] for a cell to start and run its cycles on a loaded computer
RUN = 180.0
_MARK = 'PKM_CAMPAIGN'
_TRACEBACK = re.compile(r'Traceback \(most recent call last\)|terminate called|Segmentation fault|core dumped')


class World:
    """
    One trial; a context manager that ends all processes of the trial and removes its folder.

    Every process started here, and every process started by one of those, has a mark in its environment. They are ended
    by their ids, and no process of another trial or program is touched.
    """

    def __init__(self, folder, domain=DOMAIN):
        self.folder = Path(folder)
        self.mark = uuid4().hex
        self.environment = os.environ | {
            _MARK: self.mark,
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'COLUMNS': '200',
        }

    def __enter__(self):
        self.folder.mkdir(parents=True)
        return self

    def __exit__(self, *_):
        self.end_all()
        shutil.rmtree(self.folder, ignore_errors=True)

    def start(self, *command, log='log', before=None, **environment):
        """Start a program with its output in `log`; `before` runs in the new process before the program."""
        with (self.folder / f'{log}.txt').open('w') as stream:
            return subprocess.Popen(
                [str(word) for word in command],
                env=self.environment | environment,
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=before,  # noqa: PLW1509 (takes no lock)
            )

    def pkm(self, *arguments, **options):
        """Start the command `pkm`."""
        return self.start(BIN / 'pkm', *arguments, **options)

    def node(self, executable, *arguments, **options):
        """Start an executable of pkm_nodes, as `ros2 run` does."""
        return self.start(EXECUTABLES / executable, *arguments, **options)

    def foreign(self, module, *arguments, log):
        """Start a module of this package as a program of someone else that knows the interfaces of the cell."""
        path = os.pathsep.join(filter(None, [str(TESTS), os.environ.get('PYTHONPATH')]))
        return self.start(sys.executable, '-m', f'campaign.{module}', *arguments, log=log, PYTHONPATH=path)

    def text(self, log='log'):
        """Return what a program has printed so far."""
        return (self.folder / f'{log}.txt').read_text(errors='replace')

    def running(self):
        """Return {process id: command line} of all processes of this trial."""
        found = {}
        for entry in Path('/proc').iterdir():
            if not entry.name.isdigit():
                continue
            with suppress(OSError):
                marked = f'{_MARK}={self.mark}'.encode() in (entry / 'environ').read_bytes().split(b'\0')
                state = (entry / 'stat').read_text().rpartition(')')[2].split()[0]
                if marked and state not in 'ZX':
                    found[int(entry.name)] = (entry / 'cmdline').read_bytes().replace(b'\0', b' ').decode()
        return found

    def find(self, node):
        """Return the process id of a `node` of a cell in processes; None while it does not run."""
        for pid, command in self.running().items():
            if f'__node:={node} ' in command or f'{EXECUTABLES}/{node} ' in command:
                return pid
        return None

    def end_all(self):
        """Kill all processes of this trial and wait until they are gone."""
        deadline = monotonic() + 10.0
        while (left := self.running()) and monotonic() < deadline:
            for pid in left:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            sleep(0.05)

    def wait_for(self, condition, timeout, what):
        """Return the first true value of `condition()`; `FellShortError` after `timeout` [s, wall]."""
        deadline = monotonic() + timeout
        while not (value := condition()):
            if monotonic() > deadline:
                raise FellShortError(f'{what} not within {timeout:.0f} s')
            sleep(0.02)
        return value

    def code_of(self, process, timeout, what):
        """Return the exit code of a `process` that must end within `timeout` [s, wall]."""
        try:
            return process.wait(timeout)
        except subprocess.TimeoutExpired:
            bags = len(list(self.folder.glob('*/bags/*')))
            reason = f'no end within {timeout:.0f} s; {bags} bags; it printed: {self.tail()}'
            raise FellShortError(f'{what}: {reason}') from None

    def tail(self, log='log'):
        """Return the end of what a program has printed, on one line."""
        return ' | '.join(self.text(log).splitlines()[-4:])[-600:]

    def require_nothing_left(self, timeout=15.0):
        """Raise `FellShortError` if a process of the trial still runs after `timeout` [s, wall]."""
        self.wait_for(lambda: not self.running(), timeout, f'the end of {list(self.running().values())[:3]}')

    def require_no_traceback(self, what=''):
        """Raise `FellShortError` if a program or node of the trial, `what`, has printed a traceback or crashed."""
        for path in [*self.folder.glob('*.txt'), *self.folder.rglob('*.log')]:
            text = path.read_text(errors='replace')
            if found := _TRACEBACK.search(text):
                lines = text[found.start() :].splitlines()
                raise FellShortError(f'{what}{path.name}: {lines[0]} ... {" | ".join(lines[-7:])[-600:]}')

    def figures(self, out):
        """Return the figures of a run in `out` that depend on nothing but seed and configuration."""
        results = json.loads((out / 'results.json').read_text())
        return [cycle['axes'] for cycle in results['cycles']]

    def require_whole_bags(self, out):
        """
        Raise `FellShortError` if a bag under `out` lacks a tick between its first and its last.

        A bag that its recorder did not close is repaired first; the open chunk at its end may be lost.
        """
        from pkm_core.bag.repair import repair

        for bag in sorted(path for path in out.glob('bags/*') if path.is_dir()):
            if not any(bag.glob('*.mcap')):
                continue  # killed before the first chunk
            repaired = repair(bag)
            _require_consecutive_ticks(repaired.path if repaired else bag)


def _require_consecutive_ticks(bag):
    from pkm_core.bag.reader import read_topics

    for topic, samples in read_topics(bag, ENCODERS).items():
        ticks = [sample.tick for sample in samples]
        if ticks and ticks != list(range(ticks[0], ticks[0] + len(ticks))):
            raise FellShortError(f'{bag.name}: {topic} lacks ticks between {ticks[0]} and {ticks[-1]}')
