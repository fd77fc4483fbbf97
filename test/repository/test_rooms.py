"""
The rooms of the two packages: what each may import, read from the imports themselves.

`ROOMS` is the plan. A room imports itself, the ground and the rooms in its line, and nothing else.
"""

import pytest

from support.rooms import GROUND, arrows, imports_of_the_house, modules, room_of

CORE = {
    GROUND: '',
    'servo': '',
    'machines': '',
    'motion': 'machines',
    'plant': 'machines',
    'control': 'machines',
    'thesis': 'control',
    'tuning': 'control thesis',
    'learning': 'control motion machines',
    'bag': 'motion machines',
    'identification': 'control machines motion bag',
    'recording': 'bag machines control',
    'design': 'machines motion bag thesis',
    'simulation': 'plant control learning identification motion machines design',
    'reporting': 'bag machines motion thesis recording',
    'experiments': 'machines motion plant control thesis tuning learning bag identification recording simulation '
    'design reporting',
    'commissioning': 'control tuning identification simulation learning reporting recording plant design machines '
    'motion',
    'api': 'machines motion plant control thesis tuning learning bag identification recording simulation design '
    'reporting experiments commissioning',
    'verbs': 'machines motion plant control thesis tuning learning bag identification recording simulation design '
    'reporting experiments commissioning',
}
# of pkm_nodes; every room but executables and runtime may import any room of the core but verbs
NODES = {
    'graph': '',
    'runtime': '',
    'executables': 'runtime',
    'messages': '',
    'parts': 'runtime messages',
    'page': '',
    'nodes': 'parts page graph runtime messages',
    'clients': 'parts graph runtime messages',
    'bench': 'clients graph runtime messages',
    'ros2': 'runtime messages',
    'verbs': 'executables graph runtime messages parts page nodes clients bench ros2',
}
# rooms that may read the truth of the simulated machine
TRUTH = 'pkm_core.plant.truth'
MAY_READ_TRUTH = {'pkm_core.plant', 'pkm_core.simulation'}
LISTS_ITS_KEYS = {'pkm_core.verbs.config_page'}  # for docs/parameters.md; reads no file


def allowed(room):
    """Return the rooms that `room` may import."""
    package, _, name = room.partition('.')
    if package == 'pkm_core':
        return {GROUND, *(f'pkm_core.{other}' for other in CORE[name or GROUND].split())}
    core = {GROUND} if name in ('executables', 'runtime') else {GROUND, *(f'pkm_core.{other}' for other in CORE)}
    if name != 'verbs':
        core -= {'pkm_core.verbs'}
    return core | {f'pkm_nodes.{other}' for other in NODES.get(name, '').split()}


@pytest.mark.parametrize('room', sorted({room_of(module) for module in modules()}))
def test_room_imports_only_rooms_in_its_line(room):
    found = arrows()[room]
    forbidden = [str(each) for target in set(found) - allowed(room) for each in found[target]]
    assert not forbidden


def test_every_room_is_in_the_plan_and_every_line_is_a_room():
    planned = {GROUND, 'pkm_nodes'} | {f'pkm_core.{name}' for name in CORE if name != GROUND}
    assert {room_of(module) for module in modules()} == planned | {f'pkm_nodes.{name}' for name in NODES}


def test_plan_has_no_circle():
    """Every room can be taken out of the plan once all it imports are out."""
    plan = {room: allowed(room) - {room} for room in {room_of(module) for module in modules()}}
    while plan:
        free = {room for room, targets in plan.items() if not targets & plan.keys()}
        assert free, f'circle among {sorted(plan)}'
        plan = {room: targets for room, targets in plan.items() if room not in free}


def test_core_never_imports_the_nodes():
    assert not [str(each) for each in imports_of_the_house() if each.imported.startswith('pkm_nodes') and
                each.importer.startswith('pkm_core')]  # fmt: skip


def test_truth_is_read_by_plant_and_simulation_only():
    readers = [each for each in imports_of_the_house() if each.imported == TRUTH]
    assert {room_of(each.importer) for each in readers} >= {'pkm_core.plant'}
    others = {each.importer for each in readers if room_of(each.importer) not in MAY_READ_TRUTH}
    assert others == LISTS_ITS_KEYS


def test_commissioning_builds_plants_but_never_looks_into_one():
    used = {each.imported for each in imports_of_the_house() if each.importer.startswith('pkm_core.commissioning')}
    assert {module for module in used if module.startswith('pkm_core.plant')} == {'pkm_core.plant.random_truth'}


def test_no_controller_reaches_the_plant_through_others():
    """Followed through every import: controllers, learning, tuning and identification never meet plant."""
    targets = {}
    for each in imports_of_the_house():
        targets.setdefault(each.importer, set()).add(each.imported)
    for room in ('control', 'learning', 'tuning', 'identification', 'motion', 'machines', 'bag'):
        todo = [module for module in modules() if room_of(module) == f'pkm_core.{room}']
        reached = set()
        while todo:
            module = todo.pop()
            if module not in reached:
                reached.add(module)
                todo += targets.get(module, ())
        assert not [module for module in reached if room_of(module) == 'pkm_core.plant'], room
