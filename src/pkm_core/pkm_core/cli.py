"""
The command `pkm`: one verb per tool.

All verbs come from the entry-point group `pkm.verbs`, those of this package and of packages above it.
"""

import sys
from importlib.metadata import entry_points, version
from typing import Annotated

import typer

from pkm_core.errors import PkmError

app = typer.Typer(
    help='Tools of the parallel-manipulator cell. Verbs that compute figures write them with --json FILE.',
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
    """Keep the form `pkm VERB` when only one verb is loaded."""


def main():
    """Run the command line; a refusal prints one line on stderr and exits with code 1."""
    verbs = {entry.name: entry for entry in sorted(entry_points(group='pkm.verbs'), key=lambda entry: entry.name)}
    # only the called verb is imported: some take seconds
    called = [verbs[sys.argv[1]]] if sys.argv[1:2] and sys.argv[1] in verbs else verbs.values()
    try:
        for entry in called:
            app.command(entry.name)(entry.load())
        app()
    except PkmError as error:
        print(f'pkm: {error}', file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)
