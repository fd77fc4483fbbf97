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
_IDLE = ('identification', 'calibration')  # a run does not need them
_RUN = 'run --cycles 30'  # more than end before the disturbance
# a node, and a client that needs it
CASES = [
    *((name, f'{_RUN} --arrangement processes') for name in (*NODES, *_IDLE)),
    ('tool_learning', f'{_RUN} --arrangement processes --learning-target tool'),
    ('computed_torque_controller', f'{_RUN} --arrangement processes --controller computed_torque'),
    ('cell', _RUN),
]
_IDENTIFY = 'identify-cell --machine planar'
_CALIBRATE = 'calibrate-cell --machine planar'
OTHER_CASES = [
    *((name, f'{_IDENTIFY} --arrangement processes') for name in ('identification', 'machine', 'joint_controller_d1')),
    *((name, f'{_CALIBRATE} --arrangement processes') for name in ('calibration', 'recorder', 'trajectory_generator')),
    ('cell', _IDENTIFY),
    ('cell', _CALIBRATE),
]
EXECUTABLES = ['cell', 'dashboard', 'joint_controller', *NODES[:6], *_IDLE, *(each for each, _ in CASES[-3:-1])]
CLIENTS = [
    'run --cycles 6',
    'run --cycles 6 --arrangement processes',
    _IDENTIFY,
    f'{_CALIBRATE} --arrangement processes',
    'experiment planar --seeds 1 --cycles 1 --arrangement composed',
    'commission --machine planar',
]
# share of the signals that a node gets in a cycle, not during the start of the cell
_BEGUN = 0.8
# [s, wall] a client needs after its answer to end a process that is stopped
_STOPPING = 15.0
# [s, wall] typical time of a start and of one cycle of a cell in processes on two cores
_START, _CYCLE = 12.0, 0.6


def _disturb(world, draw, case, sent):
    """Send the signal `sent` to a node at a random tick of a client or of its start; check client, bags, leftovers."""
    name, words = case
    out, begun = world.folder / 'run', draw.random() < _BEGUN
    client = world.pkm(*words.split(), '--out', out)
    if begun:
        bags = draw.randint(1, 3)
        world.wait_for(lambda: len(list(out.glob('bags/*'))) >= bags or client.poll() is not None, RUN, f'{bags} bags')
    pid = world.wait_for(lambda: world.find(name) or client.poll() is not None, RUN, f'the start of {name}')
    _wait(draw.uniform(0.0, _CYCLE if begun else _START), client)
    what = f'{sent.name} of {name} {"in a cycle" if begun else "after its start"}, pkm {words}'
    if client.poll() is not None:
        raise FellShortError(f'{what}: the client had ended before: {world.tail()}')
    os.kill(pid, sent)
    runs_on = name in _IDLE and sent == signal.SIGSTOP and words.startswith(_RUN)
    slow = runs_on or not begun  # the start of a cell takes longer on a loaded computer
    code = world.code_of(client, RUN if slow else ANSWER + _STOPPING, what)
    if code == 0 and not runs_on:
        raise FellShortError(f'{what}: exit code 0')
    named = name.replace('joint_controller_', 'joint_controller of '), name
    if code != 0 and not any(each in world.text() for each in named):
        raise FellShortError(f'{what}: not named: {world.tail()}')
    world.require_nothing_left()
    world.require_no_traceback()
    world.require_whole_bags(out)
    return f'{what}, exit code {code}'


def _wait(seconds, process):
    """Wait, but not longer than the process runs."""
    deadline = monotonic() + seconds
    while process.poll() is None and monotonic() < deadline:
        signal.sigtimedwait([], 0.02)


@attack('processes', share=4, cases=CASES)
def kill_a_node(world, draw, case):
    return _disturb(world, draw, case, signal.SIGKILL)


@attack('processes', share=4, cases=CASES)
def stop_a_node(world, draw, case):
    """A stopped process is alive, answers nothing and keeps its connections."""
    return _disturb(world, draw, case, signal.SIGSTOP)


@attack('processes', share=3, cases=OTHER_CASES)
def disturb_identification_or_calibration(world, draw, case):
    return _disturb(world, draw, case, draw.choice([signal.SIGKILL, signal.SIGSTOP]))


@attack('processes', share=3, cases=CLIENTS)
def interrupt_a_client(world, draw, words):
    """SIGINT or SIGTERM of a client that starts a cell, at any moment of start and run."""
    sent, out = draw.choice([signal.SIGINT, signal.SIGTERM]), world.folder / 'run'
    client = world.pkm(*words.split(), '--out', out)
    delay = draw.uniform(0.0, _START + 6 * _CYCLE)
    _wait(delay, client)
    what = f'{sent.name} {delay:.2f} s after the start of pkm {words}'
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


@attack('processes', share=2, cases=CLIENTS)
def kill_the_client(world, draw, words):
    """Without its client a cell must not run on."""
    out = world.folder / 'run'
    client = world.pkm(*words.split(), '--out', out)
    delay = draw.uniform(0.0, _START + 6 * _CYCLE)
    _wait(delay, client)
    client.kill()
    client.wait()
    world.require_nothing_left(ANSWER)
    world.require_no_traceback()
    world.require_whole_bags(out)
    return f'SIGKILL of pkm {words} after {delay:.2f} s'


@attack('processes', share=3, cases=EXECUTABLES)
def interrupt_an_executable(world, draw, name):
    """SIGINT or SIGTERM of one node at any moment of its start."""
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
