"""
The command `pkm`: one verb a tool.

Verbs of the core are added here; packages above it add theirs through the entry-point group `pkm.verbs`.
"""

import sys
from importlib.metadata import entry_points, version
from typing import Annotated

import typer

from pkm_core.errors import PkmError

app = typer.Typer(
    help='Tools of the parallel-manipulator cell. Every verb that yields figures takes --json FILE.',
    no_args_is_help=True,
    rich_markup_mode='markdown',
    context_settings={'help_option_names': ['-h', '--help']},
    pretty_exceptions_enable=False,
)


def _print_version(wanted: bool):
    if wanted:
        print(version('pkm_core'))
        raise typer.Exit


@app.callback()
def _pkm(
    _version: Annotated[
        bool, typer.Option('--version', is_eager=True, callback=_print_version, help='Print the version and exit.')
    ] = False,
):
    """Keep `pkm VERB` the form even while there is only one verb."""


def main():
    """Run the command line; a refusal is one line on stderr and code 1."""
    verbs = {entry.name: entry for entry in sorted(entry_points(group='pkm.verbs'), key=lambda entry: entry.name)}
    # only the verb that is called is imported, for some take seconds
    called = [verbs[sys.argv[1]]] if sys.argv[1:2] and sys.argv[1] in verbs else verbs.values()
    for entry in called:
        app.command(entry.name)(entry.load())
    try:
        app()
    except PkmError as error:
        print(f'pkm: {error}', file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)
