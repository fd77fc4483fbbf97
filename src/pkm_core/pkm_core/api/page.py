"""The page docs/api.md, from `pkm_core.__all__` and the docstrings: ``python -m pkm_core.api.page > docs/api.md``."""

import inspect
import re
from collections.abc import Iterator
from typing import Any

import pkm_core

HEAD = """# The Python library

<!-- generated: .venv/bin/python -m pkm_core.api.page > docs/api.md -->

`import pkm_core as pkm` is the cell as a library, without ROS: machines, motions, the closed loop, bags, linear models
and identification. Names are loaded at first use. Lengths are in metres, times in seconds, voltages in volts and
frequencies in hertz; arrays have one row per sample and one column per joint. Results are frozen; those with `plot()`
return a matplotlib `Figure` and do not touch pyplot. Errors are subclasses of `PkmError`, which is a `ValueError`. In
the examples below `np` is numpy.

The [examples](examples/README.md) are short programs that use it.
"""
GROUPS = {
    'Machines and motions': ('load_machine', 'Machine', 'Configuration', 'plan', 'PlannedMotion'),
    'Simulation': ('simulate', 'Simulation', 'Controller', 'LearningLaw'),
    'Bags': ('read_cycle', 'Cycle'),
    'Linear models': ('axis_system', 'loop_system', 'margins', 'LoopMargins'),
    'Identification': ('run_experiments', 'identify', 'Identification'),
    'Errors': (
        'PkmError', 'ConfigError', 'WorkspaceError', 'TrajectoryError', 'LearningError', 'BagError',
        'IdentificationError',
    ),
}  # fmt: skip
_SECTION = re.compile(r'^(\w+)\n-+\n', re.MULTILINE)  # as numpydoc writes them
_LONG = 90  # characters of a signature


def page() -> str:
    """Return the text of the page."""
    parts = [HEAD]
    for title, names in GROUPS.items():
        parts += [f'## {title}\n', *(_described(name, getattr(pkm_core, name)) for name in names)]
    return '\n'.join(parts) + '\n'


def _described(name: str, item: Any) -> str:
    if isinstance(item, type) and issubclass(item, Exception):
        return f'- `{name}`: {inspect.getdoc(item)}'
    lines = [f'### {name}\n']
    if not isinstance(item, type):
        lines += [f'```text\n{name}{_signature(item)}\n```\n']
    lines += [_docstring(item)]
    if isinstance(item, type):
        lines += ['\n'.join(_member(method, value) for method, value in _members(item)) + '\n']
    return '\n'.join(lines)


def _members(item: type) -> Iterator[tuple[str, Any]]:
    for name, value in vars(item).items():
        described = isinstance(value, property) or inspect.isfunction(value)
        if described and not name.startswith('_') and inspect.getdoc(value):
            yield name, value


def _member(name: str, value: Any) -> str:
    text = ' '.join((inspect.getdoc(value) or '').split('\n\n')[0].split())
    shown = name if isinstance(value, property) else f'{name}({_names(value)})'
    return f'- `{shown}`: {text}'


def _signature(function: Any) -> str:
    """Return the signature as it is written; one parameter per line if it is long."""
    signature, keywords = inspect.signature(function), False
    parts: list[str] = []
    for name, each in signature.parameters.items():
        if each.kind is each.KEYWORD_ONLY and not keywords:
            parts, keywords = [*parts, '*'], True
        if name != 'self':
            default = '' if each.default is each.empty else f' = {each.default!r}'
            parts.append(name + ('' if each.annotation is each.empty else f': {each.annotation}') + default)
    returns = '' if signature.return_annotation is signature.empty else f' -> {signature.return_annotation}'
    short = f'({", ".join(parts)}){returns}'
    return short if len(short) < _LONG else '(\n' + ''.join(f'    {part},\n' for part in parts) + f'){returns}'


def _names(method: Any) -> str:
    return ', '.join(name for name in inspect.signature(method).parameters if name != 'self')


def _docstring(item: Any) -> str:
    """Return a numpydoc docstring as Markdown."""
    text, *sections = _SECTION.split((inspect.getdoc(item) or '').rstrip() + '\n')
    parts = [text.strip() + '\n']
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        parts.append(f'**{title}**\n')
        parts.append(_example(body) if title == 'Examples' else _entries(body))
    return '\n'.join(parts)


def _example(body: str) -> str:
    return f'```pycon\n{body.strip()}\n```\n'


def _entries(body: str) -> str:
    """Return the entries of a section as a list."""
    lines: list[str] = []
    for line in body.strip().splitlines():
        if line.startswith(' '):
            lines[-1] += ' ' + line.strip()
        elif line:
            name, _, kind = line.partition(' : ')
            lines.append(f'- `{name}`' + (f' ({kind}):' if kind else ':'))
    return '\n'.join(lines) + '\n'


if __name__ == '__main__':
    print(page(), end='')
