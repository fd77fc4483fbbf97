"""Bags of one start of a cell: a result is made only from bags of the session, seed and environment that it names."""

import json
from contextlib import suppress
from pathlib import Path

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import read_metadata
from pkm_core.errors import BagError


def read_own(bags, cell):
    """
    Yield the `CycleRecord`s of `bags`, all recorded by `cell`.

    Parameters
    ----------
    bags : iterable of Path
        As the recorder reported them.
    cell : CellProcesses
        The cell that ran the cycles.

    Raises
    ------
    BagError
        If a bag lies outside the folder of the cell or names another session, seed or environment; each difference is
        named with both values.

    """
    for path in bags:
        yield _checked(read_cycle(path), cell)


def complete_of(bags, cell):
    """Yield the `CycleRecord`s of those of `bags` that are whole, of a goal that has ended early; else `read_own`."""
    for path in bags:
        with suppress(BagError):
            record = read_cycle(path)
            if record.is_whole:
                yield _checked(record, cell)


def losses_in(folder):
    """Return one line for each closed bag in `folder` that lacks messages: its end, topics, and lost ticks."""
    lines = []
    for path in sorted(Path(folder).iterdir()):
        try:
            facts = read_metadata(path)['custom_data']
            lost, ticks = (json.loads(facts.get(name) or '{}') for name in ('lost', 'lost_ticks'))
        except (BagError, ValueError, KeyError, TypeError) as error:
            lines.append(f'{path.name}: cannot be read: {error}; pkm bag-doctor repairs bags')
            continue
        if lost:
            lines.append(f'{path.name}: {facts.get("end", "")}; {_lost(lost, ticks)}')
    return lines


def _lost(lost, ticks):
    runs = {}  # topics by lost ticks
    for topic, of_topic in ticks.items():
        runs.setdefault(', '.join(f'{first} to {last}' for first, last in of_topic), []).append(topic)
    named = [f'ticks {text} of {", ".join(topics)}' for text, topics in runs.items() if text]
    return '; '.join([f'{sum(lost.values())} messages of {len(lost)} topics are lost', *named])


def _checked(record, cell):
    found = {'folder': str(Path(record.path).resolve().parent), 'session': record.facts.get('session', '')}
    expected = {'folder': str(cell.bags.resolve()), 'session': cell.session}
    machine = (json.loads(record.facts.get('parameters') or '{}') or {}).get('machine')
    if machine and 'machine' not in [spec.name for spec in cell.left_out]:
        found |= {name: machine.get(name) for name in ('seed', 'environment')}
        expected |= {'seed': cell.seed, 'environment': cell.environment}
    wrong = [
        f'{name} {found[name]!r}; expected {expected[name]!r}' for name in expected if found[name] != expected[name]
    ]
    if wrong:
        raise BagError(f'{record.path}: not recorded by this cell: {", ".join(wrong)}')
    return record
