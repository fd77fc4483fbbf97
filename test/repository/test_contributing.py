"""CONTRIBUTING.md: its table of rooms is the plan of test_rooms.py, and its files to copy are as short as it states."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
PLAN = runpy.run_path(str(Path(__file__).with_name('test_rooms.py')))
GROUND = PLAN['GROUND']  # the modules at the top of pkm_core, which every room may import


def table(package):
    """Return {room: rooms it may import} of the table of `package`."""
    section = TEXT.partition(f'| room of `{package}` |')[2].partition('\n\n')[0]
    rooms = {}
    for line in section.splitlines()[2:]:
        room, _, imports = (cell.strip() for cell in line.strip('|').split('|'))
        named = set(re.findall(r'`(\w+)`', imports))
        above = rooms.keys() - {GROUND} - named
        rooms[room.strip('`') if room.startswith('`') else GROUND] = above if 'every room above' in imports else named
    return rooms


@pytest.mark.parametrize(('package', 'plan'), [('pkm_core', 'CORE'), ('pkm_nodes', 'NODES')])
def test_table_of_rooms_is_the_plan(package, plan):
    assert table(package) == {room: set(allowed.split()) for room, allowed in PLAN[plan].items()}


def test_files_to_copy_have_the_stated_length():
    """`[name](path) (N lines)`, within 20 %: a file that has grown is no longer a model to copy."""
    stated = re.findall(r'\]\(([\w./]+)\)\s\((\d+) lines', TEXT)
    assert len(stated) > 4
    for path, lines in stated:
        assert len((ROOT / path).read_text(encoding='utf-8').splitlines()) == pytest.approx(int(lines), rel=0.2), path


def test_places_to_register_exist():
    """`NAME` of [file](path): the file defines or uses that name."""
    places = re.findall(r'((?:`\w+`(?: and |, )?)+)\s+of\s+\[[^\]]*\]\(([\w./]+)\)', TEXT)
    assert len(places) > 8
    for names, path in places:
        text = (ROOT / path).read_text(encoding='utf-8')
        assert all(re.search(rf'\b{name}\b', text) for name in re.findall(r'`(\w+)`', names)), (names, path)
