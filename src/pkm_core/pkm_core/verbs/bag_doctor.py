"""`pkm bag-doctor`: repair the bag of a recorder that was killed."""

from pathlib import Path
from typing import Annotated

import typer

from pkm_core.verbs.console import Output, table
from pkm_core.verbs.options import JsonOption, OverwriteOption, write_figures


def bag_doctor(
    path: Annotated[Path, typer.Argument(help='Folder of a bag, or its MCAP file.')],
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Repair a bag that its recorder did not close: copy every complete chunk into a new bag, PATH_repaired.

    PATH is not changed, and nothing is overwritten. Prints the saved messages per topic and the missing ticks.

    Example: `pkm bag-doctor runs/bags/four_dof_70ms_0003_20260101T120000`
    """
    from pkm_core.bag.repair import lost_messages, repair

    console = Output()
    done = repair(path)
    if done is None:
        lost = lost_messages(path)
        console.plain(f'{path} is complete; nothing to repair')
        if lost:
            listed = ', '.join(f'{topic} {count}' for topic, count in lost.items())
            console.plain(f'messages that had not arrived when the recorder closed it: {listed}')
        write_figures(json_file, {'repaired': False, 'lost': lost})
        return
    rows = [
        (topic, str(count), _ticks(done.missing[topic]) if topic in done.missing else '')
        for topic, count in done.saved.items()
    ]
    console.print(table('saved', ['topic', 'messages', 'missing ticks'], rows, align='lrl'))
    if done.damaged_chunks:
        console.print(f'{done.damaged_chunks} chunks were damaged')
    if done.lost_bytes:
        console.print(f'the last {done.lost_bytes} bytes of the file belong to no complete record')
    console.plain(f'{sum(done.saved.values())} messages are in {done.path}')
    write_figures(json_file, {'repaired': True} | vars(done) | {'path': str(done.path)})


def _ticks(ranges):
    """Return ranges of ticks as text."""
    spans = [str(first) if first == last else f'{first} to {last}' for first, last in ranges]
    return ', '.join(spans) or 'none'
