"""Run the campaign: `bringup_scripts/campaign --seed 1 --minutes 30`."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from campaign import files, messages, processes, requests, soak, surroundings  # noqa: F401 (they register their attacks)
from campaign.attacks import ATTACKS, campaign
from campaign.world import World

_MANY = 20  # share from which on a trial is short and one of many
KINDS = sorted({each.kind for each in ATTACKS})


def main(
    seed: Annotated[int, typer.Option(help='Seed of the random numbers.')] = 1,
    minutes: Annotated[float, typer.Option(min=0.0, help='Time after which no new trial begins.')] = 30.0,
    trials: Annotated[int, typer.Option(min=1, help='Most trials.')] = 100_000,
    only: Annotated[
        list[str] | None, typer.Option(help=f'Kind or attack, repeatable. Kinds: {", ".join(KINDS)}.')
    ] = None,
    case: Annotated[str, typer.Option(help='Only the cases of an attack that contain this text, e.g. a node.')] = '',
    json_file: Annotated[Path | None, typer.Option('--json', help='Write the outcomes to this file.')] = None,
):
    """Disturb cells and tools at random, count what held, and print each trial and one table."""
    chosen = [each for each in ATTACKS if not only or {each.kind, each.name, each.name.replace(' ', '_')} & set(only)]
    if not chosen:
        raise typer.BadParameter(
            f'--only {only}: no such kind or attack; allowed: {KINDS}, {[a.name for a in ATTACKS]}'
        )
    if case:
        left = {each: tuple(one for one in each.cases if case in str(one)) for each in chosen}
        chosen = [replace(each, cases=cases) for each, cases in left.items() if cases]
        if not chosen:
            raise typer.BadParameter(f'--case {case}: no such case of {[each.name for each in left]}')
    console = Console()
    with TemporaryDirectory(prefix='pkm_campaign_') as folder:
        tallies = campaign(
            chosen,
            seed,
            60.0 * minutes,
            trials,
            lambda number: World(Path(folder) / str(number)),
            lambda number, each, outcome: _tell(console, number, each, outcome),
        )
    console.print(_table(tallies, seed))
    for each, tally in tallies.items():
        for number, fault in tally.failures:
            console.print(f'{each.name}, trial {number}: {fault}', soft_wrap=True, markup=False, highlight=False)
        if tally.skipped:
            console.print(f'{each.name}: {tally.skipped}', soft_wrap=True, markup=False, highlight=False)
    if json_file:
        json_file.write_text(json.dumps({each.name: vars(tally) for each, tally in tallies.items()}, indent=2))
    sys.exit(any(tally.failures for tally in tallies.values()))


def _tell(console, number, each, outcome):
    """Print a trial; of the many short ones only those that fell short."""
    if each.share < _MANY or not outcome.startswith('held'):
        console.print(f'{number:5} {each.name}: {outcome}', soft_wrap=True, markup=False, highlight=False)


def _table(tallies, seed):
    table = Table('kind', 'attack', 'tried', 'held', 'fell short', title=f'campaign, seed {seed}')
    for each, tally in tallies.items():
        tried = tally.held + len(tally.failures)
        table.add_row(each.kind, each.name, str(tried), str(tally.held), str(len(tally.failures)))
    return table


typer.run(main)
