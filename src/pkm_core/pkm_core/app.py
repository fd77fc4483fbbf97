"""
The command line `pkm` as a typer application: one verb per tool.

All verbs come from the entry-point group `pkm.verbs`, those of this package and of packages above it. A verb is
imported when it is called, because some take seconds; lists of verbs describe it by the docstring in its source.
"""

import ast
from functools import cache
from importlib.metadata import entry_points, version
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperCommand, TyperGroup

_SETTINGS = {'help_option_names': ['-h', '--help']}


@cache
def _entries():
    """Return {verb: entry point}, sorted by verb."""
    return {entry.name: entry for entry in sorted(entry_points(group='pkm.verbs'), key=lambda entry: entry.name)}


class _Verbs(TyperGroup):
    """All verbs."""

    def list_commands(self, ctx):
        """Return the names of the verbs."""
        return list(_entries())

    def get_command(self, ctx, cmd_name):
        """Return a command to describe, not to run; None for an unknown verb."""
        if cmd_name not in self.commands and cmd_name in _entries():
            self.add_command(_described(_entries()[cmd_name]))
        return super().get_command(ctx, cmd_name)

    def resolve_command(self, ctx, args):
        """Return the verb that is called, imported."""
        self.commands = {name: self.get_command(ctx, name) for name in _entries()}  # also those a typing error may mean
        if args[0] in _entries():
            self.add_command(_imported(_entries()[args[0]]))
            return args[0], self.commands[args[0]], args[1:]
        return super().resolve_command(ctx, args)


def _described(entry):
    """Return a command with name and help of the verb `entry`, read without importing it."""
    module, _, function = entry.value.partition(':')
    source = find_spec(module)
    if source is None or source.origin is None:
        raise ImportError(f'entry point {entry.name}: no module {module}')
    parsed = ast.parse(Path(source.origin).read_bytes())
    found = next(each for each in parsed.body if isinstance(each, ast.FunctionDef) and each.name == function)
    return TyperCommand(entry.name, help=ast.get_docstring(found), rich_markup_mode='markdown')


def _imported(entry):
    """Return the command of the verb `entry`."""
    verb = typer.Typer(
        add_completion=False, rich_markup_mode='markdown', context_settings=_SETTINGS, pretty_exceptions_enable=False
    )
    verb.command(entry.name)(entry.load())
    return typer.main.get_command(verb)


app = typer.Typer(
    cls=_Verbs,
    help='Tools of the parallel-manipulator cell. Verbs that compute figures write them with --json FILE.',
    no_args_is_help=True,
    rich_markup_mode='markdown',
    context_settings=_SETTINGS,
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
