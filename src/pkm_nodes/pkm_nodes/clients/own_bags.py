"""Bags of one start of a cell: a result is made only from bags of the session, seed and environment that it names."""

import json
from pathlib import Path

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.errors import BagError


def read_own(bags, cell):
    """
    Return the `CycleRecord`s of `bags`, all recorded by `cell`.

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
    return [_checked(read_cycle(path), cell) for path in bags]


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
