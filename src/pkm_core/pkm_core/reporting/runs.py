"""Reads the folder of a run: its results.json and its bags."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.errors import BagError, PkmError
from pkm_core.machines import load_machine


@dataclass(frozen=True)
class Run:
    """A run: `records` are its complete cycles in order, `remarks` the reasons for the missing ones."""

    name: str
    machine: object
    facts: dict[str, object]  # settings of the run
    records: list
    remarks: list[str]


def read_runs(folders, on_step=lambda text: None):
    """Return the `Run`s in `folders`, named by folder or, for equal names, by path."""
    runs = []
    for folder in folders:
        on_step(f'reading {folder}')
        runs.append(read_run(folder))
    if len({run.name for run in runs}) < len(runs):
        runs = [replace(run, name=str(folder)) for run, folder in zip(runs, folders, strict=True)]
    return runs


def read_run(folder):
    """
    Return the `Run` in `folder`: the output of `pkm run`, or a folder of bags.

    Raises
    ------
    PkmError
        If there is no complete cycle, the cycles have several motions, or the machine is unknown.

    """
    folder = Path(folder)
    if not folder.is_dir():
        what = 'is no folder' if folder.exists() else 'does not exist'
        raise PkmError(f'{folder}: {what}; expected the output of pkm run, or a folder of bags')
    paths = sorted({file.parent for pattern in ('*/*.mcap', 'bags/*/*.mcap') for file in folder.glob(pattern)})
    records, remarks = [], []
    for path in paths:
        try:
            record = read_cycle(path)
        except BagError as error:
            remarks.append(str(error))
            continue
        if record.is_whole:
            records.append(record)
        else:
            remarks.append(f'{path}: ends after {len(record.ticks)} of {record.samples} ticks')
    if not records:
        raise PkmError('; '.join([f'{folder}: no complete cycle in {len(paths)} bags', *remarks]))
    motions = sorted({record.motion for record in records})
    if len(motions) > 1:
        raise PkmError(f'{folder}: has cycles of several motions, {motions}; expected one motion')
    # facts that are equal in all bags are those of the run
    facts = {k: v for k, v in records[0].facts.items() if all(record.facts.get(k) == v for record in records)}
    facts |= _results(folder)
    if 'machine' not in facts:
        raise PkmError(f'{folder}: neither results.json nor the bags name the machine')
    machine = load_machine(facts['machine'])
    for record in records:
        if record.joints != machine.joints:
            raise BagError(
                f'{record.path}: has joints {list(record.joints)}; {machine.name} has {list(machine.joints)}'
            )
    return Run(folder.name, machine, facts, records, remarks)


def _results(folder):
    """Return the scalar values of results.json, {} without the file; the figures are computed from the bags."""
    file = folder / 'results.json'
    if not file.exists():
        return {}
    try:
        results = json.loads(file.read_text(encoding='utf-8'))
        return {key: value for key, value in results.items() if not isinstance(value, (dict, list))}
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise PkmError(f'{file}: cannot be read as the results of a run: {error}') from None
