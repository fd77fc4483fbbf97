"""Many cycles in one goal: memory, file handles, threads, figures and recorded ticks are steady."""

import json
import resource
from contextlib import suppress
from pathlib import Path
from time import sleep

from campaign.attacks import FellShortError, attack
from campaign.world import RUN

_WARM = 50  # cycles after which nothing may grow
# allowed growth per process: resident memory [MB], open files, threads
_GROWTH = {'MB': 30.0, 'files': 4, 'threads': 2}


@attack('surroundings')
def soak(world, draw):
    """2,000 cycles of a composed cell."""
    return _soak(world, 'composed', 2000)


@attack('surroundings')
def soak_in_processes(world, draw):
    """300 cycles of a cell in processes."""
    return _soak(world, 'processes', 300)


def _soak(world, arrangement, cycles):
    """Run `cycles` and check the growth of each process, the figures of each cycle, and each tick of each bag."""
    out = world.folder / 'run'
    client = world.pkm('run', '--arrangement', arrangement, '--cycles', cycles, '--out', out)
    world.wait_for(lambda: len(list(out.glob('bags/*'))) >= _WARM or client.poll() is not None, RUN, f'{_WARM} cycles')
    first, largest = _usage(world), {}
    while client.poll() is None:
        for process, usage in _usage(world).items():
            before = largest.setdefault(process, usage)
            largest[process] = {name: max(before[name], value) for name, value in usage.items()}
        sleep(1.0)
    if client.returncode:
        raise FellShortError(f'{cycles} cycles: {world.tail()}')
    grown = [
        f'{process}: {first[process][name]:.0f} to {largest[process][name]:.0f} {name}'
        for process in sorted(first.keys() & largest.keys())
        for name, allowed in _GROWTH.items()
        if largest[process][name] > first[process][name] + allowed
    ]
    if grown:
        raise FellShortError(f'{cycles} cycles: {"; ".join(grown)}')
    _require_every_message(out, cycles)
    world.require_no_traceback()
    world.require_whole_bags(out)
    return f'{arrangement}, {cycles} cycles; ' + _told(first, largest)


def _require_every_message(out, cycles):
    """Raise `FellShortError` unless `results.json` has all cycles and all messages, and the last cycles are steady."""
    results = json.loads((out / 'results.json').read_text())
    if len(results['cycles']) != cycles:
        raise FellShortError(f'{len(results["cycles"])} of {cycles} cycles in results.json')
    for topic, counts in results['messages'].items():
        if counts['expected'] not in (None, counts['recorded']):
            raise FellShortError(f'{topic}: {counts["recorded"]} of {counts["expected"]} messages recorded')
    worst = [max(axis['max_dynamic_error_um'] for axis in cycle['axes'].values()) for cycle in results['cycles']]
    middle, last = max(worst[20:120]), max(worst[-100:])
    if last > 2.0 * middle:
        raise FellShortError(f'worst axis in cycles 21 to 120: {middle:.1f} um, in the last 100: {last:.1f} um')


def _told(first, largest):
    """Return the usage of the largest process, after `_WARM` cycles and at most."""
    process = max(first, key=lambda each: first[each]['MB'])
    after = largest.get(process, first[process])
    return f'{process}: ' + ', '.join(
        f'{value:.0f} to {after[name]:.0f} {name}' for name, value in first[process].items()
    )


def _usage(world):
    """Return {program: {'MB', 'files', 'threads'}} of all processes of the trial."""
    found = {}
    for pid, command in world.running().items():
        entry = Path('/proc') / str(pid)
        with suppress(OSError):
            found[f'{_program(command)} {pid}'] = {
                'MB': int((entry / 'statm').read_text().split()[1]) * resource.getpagesize() / 1e6,
                'files': len(list((entry / 'fd').iterdir())),
                'threads': len(list((entry / 'task').iterdir())),
            }
    return found


def _program(command):
    """Return the name of the program of a command line of Python."""
    return next((Path(word).name for word in command.split() if 'python' not in Path(word).name), command[:40])
