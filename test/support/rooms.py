"""Which rooms of the two packages there are, what each may import, and what the code does import."""

import ast
from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2] / 'src'
GROUND = 'pkm_core'  # the modules that lie at the top of the package


@dataclass(frozen=True)
class Import:
    """One import statement of the house: from module `importer`, line `line`, of module or package `imported`."""

    importer: str
    line: int
    imported: str

    def __str__(self):
        return f'{self.importer}:{self.line} imports {self.imported}'


@cache
def room_of(module):
    """
    Return the room of a dotted module name.

    >>> room_of('pkm_core.plant.truth'), room_of('pkm_core.errors'), room_of('pkm_nodes.graph')
    ('pkm_core.plant', 'pkm_core', 'pkm_nodes.graph')
    """
    parts = module.split('.')
    folder = SOURCE / parts[0] / Path(*parts[:2])
    if len(parts) == 1 or folder.is_dir() or parts[0] == 'pkm_nodes':
        return '.'.join(parts[:2])
    return parts[0]


@cache
def modules():
    """Return {dotted name: path} of every module of both packages; a package is called like its folder."""
    found = {}
    for package in ('pkm_core', 'pkm_nodes'):
        base = SOURCE / package
        for path in sorted((base / package).rglob('*.py')):
            parts = path.relative_to(base).with_suffix('').parts
            found['.'.join(parts[:-1] if parts[-1] == '__init__' else parts)] = path
    return found


@cache
def imports_of_the_house():
    """Return every `Import` of one module of the two packages by another, wherever in the file it stands."""
    known = modules()
    found = []
    for importer, path in known.items():
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names = [f'{node.module}.{alias.name}' for alias in node.names]
            else:
                continue
            for name in names:
                module = name if name in known else name.rpartition('.')[0]
                if module in known:
                    found.append(Import(importer, node.lineno, module))
    return found


@cache
def arrows():
    """Return {room: {room it imports: [Import, ...]}}, rooms that import themselves left out."""
    found = defaultdict(lambda: defaultdict(list))
    for each in imports_of_the_house():
        source, target = room_of(each.importer), room_of(each.imported)
        if source != target:
            found[source][target].append(each)
    return found
