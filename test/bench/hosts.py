"""
A cell on two hosts: the machine on one, its controllers on the other, with a line that delays and loses frames.

    sudo .venv/bin/python test/bench/hosts.py --json runs/hosts.json

Hosts are network namespaces with their own /dev/shm; the line is a pair of veth cables. ROS uses a discovery server on
the machine's host. Delay and loss are those of `tc netem`; on a kernel without netem, the program wire.py between the
cables delays and drops frames. For every line the bits must be those of the simulation without ROS.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.control.robust import load_control
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles

MACHINE, LAW, SEED = 'four_dof', 'fourier_pid', 7
ADDRESSES = {'machine': '10.77.0.1', 'control': '10.77.0.2'}
ON_CONTROL = ('joint_controller', 'trajectory_generator', 'inverse_kinematics', 'learning')
DISCOVERY = f'{ADDRESSES["machine"]}:11811'


@dataclass(frozen=True)
class Line:
    """Delay and loss of the line, in both directions."""

    delay: float = 0.0  # [ms]
    jitter: float = 0.0  # [ms] standard deviation
    loss: float = 0.0  # [%]

    def __str__(self):
        parts = [f'{self.delay:g} ms'] + [f'+-{self.jitter:g} ms'] * bool(self.jitter)
        return ' '.join([*parts, f'{self.loss:g} % lost'])


LINES = (Line(), Line(delay=1.0), Line(delay=1.0, jitter=0.2, loss=0.1), Line(delay=1.0, loss=1.0))


def call(*command):
    """Run a program; raise an error if it fails."""
    return subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True)


@contextmanager
def program(*command, **options):
    """Run a program for the duration of the block."""
    process = subprocess.Popen([str(word) for word in command], **options)
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


class Host:
    """A network and mount namespace, held by a sleeping process."""

    def __init__(self, stack):
        keeper = 'mount -t tmpfs tmpfs /dev/shm && ip link set lo up && echo up && exec sleep infinity'
        kept = program('unshare', '--net', '--mount', 'sh', '-c', keeper, stdout=subprocess.PIPE, text=True)
        self.process = stack.enter_context(kept)
        if self.process.stdout.readline() != 'up\n':
            raise OSError('no network namespace: hosts.py needs root and iproute2 (ip, tc)')
        self.enter = ('nsenter', '--target', str(self.process.pid), '--net', '--mount')

    def call(self, *command):
        """Run a program on this host."""
        return call(*self.enter, *command)


def connect(stack, line):
    """Return the hosts 'machine' and 'control', connected by `line`, and the source of its delay and loss."""
    hosts, wire = {name: Host(stack) for name in ADDRESSES}, Host(stack)
    for name, host in hosts.items():
        call(
            'ip',
            'link',
            'add',
            name,
            'netns',
            wire.process.pid,
            'type',
            'veth',
            'peer',
            'eth',
            'netns',
            host.process.pid,
        )
        host.call('ip', 'address', 'add', f'{ADDRESSES[name]}/24', 'dev', 'eth')
        host.call('ip', 'link', 'set', 'eth', 'up')
        wire.call('ip', 'link', 'set', name, 'up')
    impairment = ['delay', f'{line.delay}ms', f'{line.jitter}ms', 'loss', f'{line.loss}%']
    try:
        for name in hosts:
            wire.call('tc', 'qdisc', 'add', 'dev', name, 'root', 'netem', *impairment)
    except subprocess.CalledProcessError:
        script = Path(__file__).with_name('wire.py')
        for host in hosts.values():
            host.call(sys.executable, script, 'plain', 'eth')
        options = [json.dumps([line.delay, line.jitter, line.loss]), *hosts]
        stack.enter_context(program(*wire.enter, sys.executable, script, 'relay', *options))
        return hosts, 'wire.py'
    wire.call('ip', 'link', 'add', 'bridge', 'type', 'bridge')
    wire.call('ip', 'link', 'set', 'bridge', 'up')
    for name in hosts:
        wire.call('ip', 'link', 'set', name, 'master', 'bridge')
    return hosts, 'tc netem'


def run_over(line, motion, cycles):
    """Run learning cycles over `line`; return ticks/s, whether the bits match the simulation, and the impairment."""
    with ExitStack() as stack:
        hosts, by = connect(stack, line)
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        environment = os.environ | {'ROS_DISCOVERY_SERVER': DISCOVERY, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
        server = Path(sys.prefix) / 'bin' / 'fast-discovery-server'
        address, port = DISCOVERY.split(':')
        command = (server, '-i', 0, '-l', address, '-p', port)
        stack.enter_context(program(*hosts['machine'].enter, *command, stdout=subprocess.DEVNULL))
        options = json.dumps(
            {'enter_control': hosts['control'].enter, 'folder': str(folder), 'motion': motion, 'cycles': cycles}
        )
        driven = subprocess.run(
            [*hosts['machine'].enter, sys.executable, __file__, '--drive', options],
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            check=False,
        )
        if driven.returncode:
            raise RuntimeError(f'the cell failed over a line of {line}')
        log = json.loads(driven.stdout.splitlines()[-1])
        same = same_bits([read_cycle(Path(bag)) for bag in log['bags']], simulate(motion, cycles))
        return {'line': str(line), 'by': by, 'ticks_per_second': log['ticks'] / log['seconds'], 'same_bits': same}


def drive(enter_control, folder, motion, cycles):
    """
    Start the cell from the machine's host and run the cycles; print the result as one line of JSON.

    `enter_control` is the command line that runs a program on the host of the controllers.
    """
    from pkm_nodes.clients.cell_client import CellClient
    from pkm_nodes.clients.cell_processes import CellProcesses

    class TwoHosts(CellProcesses):
        """The processes of a cell, those of the controllers on the other host."""

        def command(self, executable):
            there = enter_control if executable in ON_CONTROL else []
            return [*there, *super().command(executable)]

    cell = TwoHosts(MACHINE, 'processes', seed=SEED, environment='nominal', folder=folder)
    with cell, CellClient() as client:
        client.wait_until_up(cell.check)
        log = client.execute(motion, cycles, LAW, cell.check, lambda feedback: None)
    print(json.dumps({'ticks': log.ticks, 'seconds': log.seconds_in_cycles, 'bags': [str(bag) for bag in log.bags]}))


def simulate(motion, cycles):
    """Return the same cycles without ROS."""
    machine = load_machine(MACHINE)
    trajectory, gains = to_joints(machine, plan(machine, load_motion(motion))), load_control(machine)
    return run_cycles(machine, trajectory, gains, make_law(LAW, machine, gains), cycles, seed=SEED)


def same_bits(records, simulated):
    """Return whether every reading, voltage and error equals that of the simulation."""
    return len(records) == len(simulated.counts) and all(
        np.array_equal(getattr(record, name), getattr(simulated, name)[number])
        for number, record in enumerate(records)
        for name in ('counts', 'voltage', 'error')
    )


def main():
    """Run the cell over every line of LINES."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--cycles', type=int, default=2)
    parser.add_argument('--motion', default='four_dof_70ms')
    parser.add_argument('--json', type=Path)
    parser.add_argument('--drive', help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.drive:
        drive(**json.loads(arguments.drive))
        return
    rows = [run_over(line, arguments.motion, arguments.cycles) for line in LINES]
    table = Table(title=f'{MACHINE} on two hosts, {arguments.cycles} cycles of {arguments.motion}')
    for heading in ('line, either way', 'by', 'ticks/s', 'bits as without ROS'):
        table.add_column(heading)
    for row in rows:
        table.add_row(row['line'], row['by'], f'{row["ticks_per_second"]:.0f}', 'yes' if row['same_bits'] else 'NO')
    Console().print(table)
    if arguments.json:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        arguments.json.write_text(json.dumps(rows, indent=2) + '\n')


if __name__ == '__main__':
    main()
