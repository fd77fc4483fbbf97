"""Attacks by messages: foreign publishers on the topics of a running cell."""

from campaign.attacks import FellShortError, attack
from campaign.world import RUN

_CYCLES = 6
_REFERENCE: list = []  # figures of an undisturbed run


def reference(world):
    """Return the figures of an undisturbed run, computed once."""
    if not _REFERENCE:
        out = world.folder / 'reference'
        client = world.pkm('run', '--cycles', _CYCLES, '--out', out, log='reference')
        if world.code_of(client, RUN, 'an undisturbed run') != 0:
            raise FellShortError(f'an undisturbed run fails: {world.tail("reference")}')
        _REFERENCE.append(world.figures(out))
    return _REFERENCE[0]


@attack('messages', share=4)
def rogue_publisher(world, draw):
    """A run is refused, with the foreign node named, or has the figures of an undisturbed run; nothing else."""
    expected, out = reference(world), world.folder / 'run'
    arrangement = draw.choice(['composed', 'composed', 'processes'])
    client = world.pkm('run', '--arrangement', arrangement, '--cycles', _CYCLES, '--out', out)
    seed = draw.randrange(10**6)
    rogue = world.foreign('rogue', seed, 2 * RUN, log='rogue')
    code = world.code_of(client, RUN, f'pkm run beside {world.tail("rogue")}')
    if rogue.poll() is not None or 'topics: ' not in world.text('rogue'):
        raise FellShortError(f'the foreign node has not published: {world.tail("rogue")}')
    rogue.kill()
    rogue.wait()
    what = f'{arrangement}, rogue {seed}, {world.text("rogue").strip()}'
    world.require_no_traceback()
    if code == 0 and world.figures(out) != expected:
        number = next(k for k, (a, b) in enumerate(zip(world.figures(out), expected, strict=False), 1) if a != b)
        raise FellShortError(f'{what}: the figures differ from those of an undisturbed run from cycle {number} on')
    if code != 0 and 'rogue' not in world.text():
        raise FellShortError(f'{what}: refused without the name of the foreign node: {world.tail()}')
    world.require_nothing_left()
    world.require_whole_bags(out)
    return f'{what}: ' + ('same figures' if code == 0 else 'refused')
