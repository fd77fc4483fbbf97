"""Attacks on processes: kill, stop and interrupt at random moments of start and run."""

import os
import signal
from time import monotonic

from campaign.attacks import FellShortError, attack
from campaign.world import ANSWER, RUN

NODES = [
    'machine',
    'trajectory_generator',
    'inverse_kinematics',
    'state_estimator',
    'learning',
    'recorder',
    *(f'joint_controller_{joint}' for joint in ('d1', 'd3', 'd5', 'd7')),
]
# [s, wall] a client needs after its answer to end a process that is stopped
_STOPPING = 15.0
_CYCLES = 6
_LONG = 60  # cycles of a run that must not end before the disturbance
# [s, wall] typical time of a start and of one cycle of a cell in processes on two cores
_START, _CYCLE = 12.0, 0.6


def _disturb(world, draw, name, sent):
    """Send the signal `sent` to a node at a random tick of a run; check client, bags and leftovers."""
    out, bags = world.folder / 'run', draw.randint(1, _CYCLES - 1)
    client = world.pkm('run', '--arrangement', 'processes', '--cycles', _LONG, '--out', out)
    world.wait_for(lambda: len(list(out.glob('bags/*'))) >= bags or client.poll() is not None, RUN, f'{bags} cycles')
    _wait(draw.uniform(0.0, _CYCLE), client)
    pid = world.find(name)
    if pid is None or client.poll() is not None:
        raise FellShortError(f'{name} had ended before {sent.name}: {world.tail()}')
    os.kill(pid, sent)
    code = world.code_of(client, ANSWER + _STOPPING, f'pkm run after {sent.name} of {name}')
    if code == 0 and not (out / 'results.json').exists():
        raise FellShortError(f'{name} got {sent.name}: pkm run exits with 0 without results')
    if code != 0 and name not in world.text() and name.split('_')[0] not in world.text():
        raise FellShortError(f'{name} got {sent.name}: pkm run does not name it: {world.tail()}')
    world.require_nothing_left()
    world.require_no_traceback()
    world.require_whole_bags(out)
    return f'{sent.name} of {name}, exit code {code}'


def _wait(seconds, process):
    """Wait, but not longer than the process runs."""
    deadline = monotonic() + seconds
    while process.poll() is None and monotonic() < deadline:
        signal.sigtimedwait([], 0.02)


@attack('processes', share=3)
def kill_a_node(world, draw):
    return _disturb(world, draw, draw.choice(NODES), signal.SIGKILL)


@attack('processes', share=2)
def stop_a_node(world, draw):
    """A stopped process is alive, answers nothing and keeps its connections."""
    return _disturb(world, draw, draw.choice(NODES), signal.SIGSTOP)


@attack('processes', share=3)
def interrupt_a_run(world, draw):
    """SIGINT or SIGTERM of `pkm run` at any moment of start and run."""
    sent, arrangement = draw.choice([signal.SIGINT, signal.SIGTERM]), draw.choice(['composed', 'processes'])
    out = world.folder / 'run'
    client = world.pkm('run', '--arrangement', arrangement, '--cycles', _CYCLES, '--out', out)
    delay = draw.uniform(0.0, _START + _CYCLES * _CYCLE)
    _wait(delay, client)
    what = f'{sent.name} {delay:.2f} s after the start of pkm run --arrangement {arrangement}'
    ended = client.poll() is not None
    if not ended:
        client.send_signal(sent)
    code = world.code_of(client, ANSWER, what)
    if not ended and code not in (0, 130, 143, -sent):
        raise FellShortError(f'{what}: exit code {code}: {world.tail()}')
    world.require_nothing_left()
    world.require_no_traceback()
    world.require_whole_bags(out)
    return f'{what}, exit code {code}'


@attack('processes', share=2)
def kill_the_client(world, draw):
    """Without its client a cell must not run on."""
    arrangement, out = draw.choice(['composed', 'processes']), world.folder / 'run'
    client = world.pkm('run', '--arrangement', arrangement, '--cycles', _CYCLES, '--out', out)
    delay = draw.uniform(0.0, _START + _CYCLES * _CYCLE)
    _wait(delay, client)
    client.kill()
    client.wait()
    world.require_nothing_left(ANSWER)
    world.require_no_traceback()
    world.require_whole_bags(out)
    return f'SIGKILL of pkm run --arrangement {arrangement} after {delay:.2f} s'


@attack('processes', share=3)
def interrupt_an_executable(world, draw):
    """SIGINT or SIGTERM of one node at any moment of its start."""
    name = draw.choice(['cell', 'dashboard', 'identification', 'joint_controller', *NODES[:6]])
    sent, delay = draw.choice([signal.SIGINT, signal.SIGTERM]), draw.uniform(0.0, 5.0)
    node = world.node(name, '--ros-args', '-r', '__ns:=/pkm', *(['-p', 'joint:="d1"'] * (name == 'joint_controller')))
    _wait(delay, node)
    what = f'{sent.name} {delay:.2f} s after the start of {name}'
    if node.poll() is not None:
        raise FellShortError(f'{what}: it had ended before: {world.tail()}')
    node.send_signal(sent)
    code = world.code_of(node, ANSWER, what)
    if code not in (0, 130, 143, -sent):
        raise FellShortError(f'{what}: exit code {code}: {world.tail()}')
    world.require_no_traceback()
    return f'{what}, exit code {code}'
