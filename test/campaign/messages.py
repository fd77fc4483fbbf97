"""Attacks by messages: foreign publishers on the topics of a running cell."""

from campaign.attacks import FellShortError, attack
from campaign.world import RUN

_CYCLES = 8
_AXIS = ['command', 'cycle_error', 'cycle_metrics', 'encoder']
TOPICS = [
    '/clock',
    '/diagnostics',
    *(f'/pkm/{joint}/{name}' for joint in ('d1', 'd7') for name in _AXIS),
    *(f'/pkm/{name}' for name in ('cycle_events', 'excitation', 'geometry', 'joint_states', 'joint_trajectory')),
    *(f'/pkm/{name}' for name in ('laser', 'machine/cycle', 'markers', 'pose', 'pose_trajectory')),
    *(f'/pkm/{name}' for name in ('pose_with_covariance', 'recorder/tick', 'twist', 'joint_correction')),
]
_REFERENCES: dict = {}  # figures of undisturbed runs, per options


def reference(world, options):
    """Return the figures of an undisturbed run with `options`, computed once."""
    if options not in _REFERENCES:
        out = world.folder / 'reference'
        client = world.pkm('run', *options, '--cycles', _CYCLES, '--out', out, log='reference')
        if world.code_of(client, RUN, 'an undisturbed run') != 0:
            raise FellShortError(f'an undisturbed run fails: {world.tail("reference")}')
        _REFERENCES[options] = world.figures(out)
    return _REFERENCES[options]


def _beside_a_rogue(world, draw, topics, options=()):
    """A run is refused, with the foreign node named, or has the figures of an undisturbed run; nothing else."""
    expected, out = reference(world, options), world.folder / 'run'
    arrangement = draw.choice(['composed', 'composed', 'processes'])
    seed = draw.randrange(10**6)
    rogue = world.foreign('rogue', seed, 2 * RUN, *topics, log='rogue')
    client = world.pkm('run', *options, '--arrangement', arrangement, '--cycles', _CYCLES, '--out', out)
    code = world.code_of(client, RUN, f'pkm run --arrangement {arrangement} beside rogue {seed}, {topics}')
    what = f'{arrangement}, rogue {seed}, {world.text("rogue").strip()}'.replace('\npublishes', '')
    if rogue.poll() is not None or 'publishes' not in world.text('rogue'):
        raise FellShortError(f'{what}: the foreign node has not published: {world.tail("rogue")}')
    rogue.kill()
    rogue.wait()
    world.require_no_traceback(f'{what}: ')
    if code == 0 and (figures := world.figures(out)) != expected:
        number = next(k for k, (a, b) in enumerate(zip(figures, expected, strict=False), 1) if a != b)
        raise FellShortError(f'{what}: the figures differ from those of an undisturbed run from cycle {number} on')
    if code != 0 and 'rogue' not in world.text():
        raise FellShortError(f'{what}: refused without the name of the foreign node: {world.tail()}')
    world.require_nothing_left()
    world.require_whole_bags(out)
    return f'{what}: ' + ('same figures' if code == 0 else 'refused')


@attack('messages', share=2)
def rogue_publisher(world, draw):
    """On three topics at once."""
    return _beside_a_rogue(world, draw, ())


@attack('messages', share=4, cases=TOPICS)
def rogue_on_a_topic(world, draw, topic):
    return _beside_a_rogue(world, draw, (topic,), ('--learning-target', 'tool') if 'correction' in topic else ())
