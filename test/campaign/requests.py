"""Attacks by goals, service requests and parameters on a running cell."""

from campaign.attacks import FellShortError, attack
from campaign.world import EXECUTABLES, RUN


def _cell(world):
    return world.node('cell', '--ros-args', '-r', '__ns:=/pkm', '-p', f'folder:={world.folder}/run/bags', log='cell')


@attack('requests', share=2)
def random_requests(world, draw):
    """Every goal, request and parameter is answered within 25 s and the cell survives."""
    cell, seed = _cell(world), draw.randrange(10**6)
    fuzz = world.foreign('fuzz_requests', seed, 25, log='fuzz')
    code = world.code_of(fuzz, 2 * RUN, 'random requests')
    if code:
        raise FellShortError(f'seed {seed}: {world.tail("fuzz")}')
    if cell.poll() is not None:
        raise FellShortError(f'seed {seed}: the cell has ended with {cell.poll()}: {world.tail("cell")}')
    world.require_no_traceback()
    world.require_whole_bags(world.folder / 'run')
    return f'seed {seed}, {world.tail("fuzz")}'


@attack('requests')
def two_hundred_goals(world, draw):
    """Goals of ten clients at once are all answered, and the cell runs the next one."""
    _cell(world)
    many = world.foreign('many_goals', 10, 20, log='many')
    if world.code_of(many, 2 * RUN, '200 goals at once'):
        raise FellShortError(world.tail('many'))
    world.require_no_traceback()
    return world.tail('many')


@attack('requests')
def second_cell(world, draw):
    """Two cells in one namespace at once: one runs, the other names it."""
    commands = [EXECUTABLES / 'cell', '--ros-args', '-r', '__ns:=/pkm', '-p']
    cells = [world.start(*commands, f'folder:={world.folder}/{name}/bags', log=name) for name in ('a', 'b')]
    world.wait_for(lambda: any(cell.poll() is not None for cell in cells), RUN, 'the end of one of two cells')
    ended = next(name for name, cell in zip('ab', cells, strict=True) if cell.poll() is not None)
    if 'session' not in world.text(ended) or 'host' not in world.text(ended):
        raise FellShortError(f'the second cell does not name the first: {world.tail(ended)}')
    world.require_no_traceback()
    return f'cell {ended} refused'
