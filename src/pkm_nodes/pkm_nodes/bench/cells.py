"""Subjects of the bench with a complete cell: composed, in processes, with and without recorder and page."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from time import monotonic, sleep
from urllib.error import URLError
from urllib.request import urlopen

from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion
from pkm_interfaces.msg import CycleEvent, SampledTrajectory
from pkm_nodes.bench.no_ros import LAW
from pkm_nodes.clients.cell_client import ANSWER_TIMEOUT, CellClient
from pkm_nodes.clients.cell_processes import CellProcesses
from pkm_nodes.runtime.fast_path import SWITCH
from pkm_nodes.runtime.node import CYCLE_QOS

_SECOND = 1_000_000_000  # ns
# steps of a cycle that are timed, and [s, wall] until the message on the last one has arrived
_STEPS = {'sent', 'loaded', 'started', 'finished'}
_STEPS_TIMEOUT = 10.0
# [s, wall] until the page listens, most of it imports; and until it has discovered the cell
_PAGE_TIMEOUT, _PAGE_DISCOVERY = 60.0, 3.0
# a viewer that receives everything the page sends and draws nothing
_VIEWER = """
import signal, sys, viser
from websockets.sync.client import connect
signal.signal(signal.SIGINT, lambda *_: sys.exit())
with connect(f'ws://127.0.0.1:{sys.argv[1]}', subprotocols=[f'viser-v{viser.__version__}'], max_size=None) as socket:
    for message in socket:
        pass
"""


class NaiveProcesses(CellProcesses):
    """The same processes with rclpy's public API only."""

    def command(self, executable):
        """Return the command that starts an executable of pkm_nodes in a SingleThreadedExecutor."""
        return ['/usr/bin/env', f'{SWITCH}=1', *super().command(executable)]


class TimedClient(CellClient):
    """A client that stores when the steps of each cycle were published, by the stamps of the publishers."""

    def __enter__(self):
        super().__enter__()
        self._cycles = {}
        self._node.create_subscription(SampledTrajectory, 'pose_trajectory', self._on_trajectory, CYCLE_QOS)
        self._node.create_subscription(CycleEvent, 'cycle_events', self._on_step, CYCLE_QOS)
        return self

    def _on_trajectory(self, message, info):
        self._cycles.setdefault(message.cycle, {}).setdefault('sent', info['source_timestamp'])

    def _on_step(self, event, info):
        cycle, stamp = self._cycles.setdefault(event.cycle, {}), info['source_timestamp']
        if event.event == CycleEvent.LOADED:
            cycle['loaded'] = stamp  # the stamp of the last joint stays
        elif event.event == CycleEvent.STARTED:
            cycle['started'] = stamp
        elif event.event == CycleEvent.FINISHED:
            cycle['finished'], cycle['samples'] = stamp, event.samples

    def readers(self, topic):
        """Return the number of subscriptions of `topic`."""
        return self._node.count_subscribers(topic)

    def set_pace(self, pace, check):
        """Set the pace of the machine; its figures restart."""
        client = self._node.create_client(SetParameters, 'machine/set_parameters')
        self._spin_until(client.service_is_ready, check, ANSWER_TIMEOUT, f'the cell did not offer {client.srv_name}')
        wanted = [Parameter('pace', value=pace).to_parameter_msg()]
        answer = client.call_async(SetParameters.Request(parameters=wanted))
        self._spin_until(answer.done, check, ANSWER_TIMEOUT, f'{client.srv_name} did not answer')
        self._node.destroy_client(client)

    def take_cycles(self, number, check):
        """Wait for all steps of `number` cycles; return and clear them: dicts of `_STEPS` [ns] and samples."""
        self._spin_until(
            lambda: len(self._complete_cycles()) >= number,
            check,
            _STEPS_TIMEOUT,
            f'steps of {number} cycles have not all arrived',
        )
        cycles, self._cycles = self._complete_cycles(), {}
        return cycles

    def _complete_cycles(self):
        return [cycle for cycle in self._cycles.values() if cycle.keys() >= _STEPS]


class Cell:
    """
    A running cell that executes learning cycles, turn by turn.

    Parameters
    ----------
    machine : str
        Machine of config/machines, or a file.
    arrangement : str
        'composed', 'processes', or 'naive': processes with rclpy's own executor.
    record : bool
        Whether a recorder runs.
    page : bool
        Whether the live page runs during every turn, with a viewer.
    pace : float
        Of the machine.

    """

    def __init__(self, machine, arrangement, *, record=True, page=False, pace=0.0):
        self._motion = default_motion(load_machine(machine))
        self._record, self._page, self._pace = record, page, pace
        self._stack = ExitStack()
        self._folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix='pkm_bench_')))
        make, arrangement = (NaiveProcesses, 'processes') if arrangement == 'naive' else (CellProcesses, arrangement)
        options = {'seed': 1, 'environment': 'nominal', 'record': record, 'pace': pace}
        cell = make(machine, arrangement, **options, folder=self._folder)
        self._cell = self._stack.enter_context(cell)
        self._client = self._stack.enter_context(TimedClient())
        self._client.wait_until_up(self._cell.check)
        self._drive(2)  # warm

    def readers(self, joint):
        """Return the number of subscriptions of the joint's tick topics, by kind."""
        return {kind: self._client.readers(f'/pkm/{joint}/{kind}') for kind in ('encoder', 'command')}

    def turn(self, cycles):
        """
        Run `cycles` learning cycles and return their figures.

        ticks_per_second [1/s]: between first and last tick of the cycles. cpu_us_per_tick [us]: all processes, over
        the whole turn. delivery_ms [ms]: per cycle, from its trajectory to the last loaded controller. With a pace the
        figures of a `MachineWatch` too.
        """
        with ExitStack() as stack:
            if self._page:
                stack.enter_context(_page())
            if self._pace:
                self._client.set_pace(self._pace, self._cell.check)
            before = self._processor_time()
            steps = self._drive(cycles)
            processor = self._processor_time() - before
        ticks = sum(cycle['samples'] for cycle in steps)
        return {
            'ticks_per_second': ticks * _SECOND / sum(cycle['finished'] - cycle['started'] for cycle in steps),
            'cpu_us_per_tick': 1e6 * processor / ticks,
            'delivery_ms': [1e-6 * (cycle['loaded'] - cycle['sent']) for cycle in steps],
            **(self._client.pace_figures(self._cell.check) if self._pace else {}),
        }

    def memory(self, cycles):
        """Run `cycles` cycles and return the resident memory of all processes [MB] after them."""
        self._drive(cycles)
        page = os.sysconf('SC_PAGE_SIZE')
        statm = (Path(f'/proc/{pid}/statm').read_text().split() for pid in self._pids())
        return {'memory_mb': sum(int(fields[1]) for fields in statm) * page / 1e6}

    def close(self):
        """Stop the cell."""
        self._stack.close()

    def _drive(self, cycles):
        log = self._client.execute(
            self._motion, cycles, LAW, self._cell.check, lambda feedback: None, record=self._record
        )
        for bag in log.bags:
            shutil.rmtree(bag)
        return self._client.take_cycles(cycles, self._cell.check)

    def _pids(self):
        return [process.pid for process in self._cell.processes.values()]

    def _processor_time(self):
        """Return the processor time [s] of all processes of the cell."""
        stats = (Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split() for pid in self._pids())
        return sum(int(fields[11]) + int(fields[12]) for fields in stats) / os.sysconf('SC_CLK_TCK')


@contextmanager
def _page():
    """Run the live page with a viewer during the block."""
    port = 8400 + int(os.environ.get('ROS_DOMAIN_ID', '0'))
    with _process(Path(sys.prefix) / 'bin' / 'pkm', 'page', '--port', port):
        deadline = monotonic() + _PAGE_TIMEOUT
        while monotonic() < deadline:
            with suppress(URLError), urlopen(f'http://127.0.0.1:{port}'):
                break
            sleep(0.2)
        else:
            raise PkmError(f'pkm page: does not listen on port {port} after {_PAGE_TIMEOUT:.0f} s')
        sleep(_PAGE_DISCOVERY)
        with _process(sys.executable, '-c', _VIEWER, port):
            sleep(1.0)
            yield


@contextmanager
def _process(*command):
    """Run a program during the block."""
    started = subprocess.Popen([str(word) for word in command], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        yield started
    finally:
        started.send_signal(signal.SIGINT)
        started.wait(20)
