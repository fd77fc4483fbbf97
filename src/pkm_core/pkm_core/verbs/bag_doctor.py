"""`pkm bag-doctor`: make a whole bag of what a killed recorder has left."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from pkm_core.verbs.options import JsonOption, write_json


def bag_doctor(
    path: Annotated[Path, typer.Argument(help='Folder of a bag, or its MCAP file.')],
    json_file: JsonOption = None,
):
    """
    Repair a bag that its recorder could not close: save every whole chunk into a new bag beside it, PATH_repaired.

    PATH itself stays as it is, and nothing is overwritten. Says how much was saved and which ticks are missing.

    Example: `pkm bag-doctor runs/bags/four_dof_70ms_0003_20260101T120000`
    """
    from pkm_core.bag.repair import repair

    console = Console()
    done = repair(path)
    write_json(json_file, {'repaired': done is not None} | (vars(done) | {'path': str(done.path)} if done else {}))
    if done is None:
        console.print(f'{path} is whole; nothing to repair', soft_wrap=True)
        return
    table = Table(title='saved', title_justify='left')
    table.add_column('topic')
    table.add_column('messages', justify='right')
    table.add_column('ticks that are missing')
    for topic, count in done.saved.items():
        table.add_row(topic, str(count), _ticks(done.missing[topic]) if topic in done.missing else '')
    console.print(table)
    if done.damaged_chunks:
        console.print(f'{done.damaged_chunks} chunks were damaged')
    if done.lost_bytes:
        console.print(f'the last {done.lost_bytes} bytes of the file belong to no whole record')
    console.print(f'{sum(done.saved.values())} messages are in {done.path}', soft_wrap=True)


def _ticks(ranges):
    """Return ranges of ticks in words."""
    spans = [str(first) if first == last else f'{first} to {last}' for first, last in ranges]
    return ', '.join(spans) or 'none'
