"""What verbs share: common options, progress, the JSON file, the folder of figures."""

import json
import math
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from pkm_core.errors import PkmError

MachineOption = Annotated[str, typer.Option(help='Machine of config/machines, or a YAML file.')]
SeedOption = Annotated[int, typer.Option(min=0, help='Seed of everything random: same seed, same bits.')]
OutOption = Annotated[Path | None, typer.Option(help='Folder for figures and files; none are written without it.')]
JsonOption = Annotated[Path | None, typer.Option('--json', help='Also write every figure to this file.')]


def finite(value):
    """Refuse an option, a number or several, that is not finite; a callback for typer."""
    if not all(map(math.isfinite, value if isinstance(value, tuple) else (value,))):
        raise typer.BadParameter(f'{value} given; expected finite numbers')
    return value


@contextmanager
def progress(console, total):
    """Show a bar of `total` steps; yields a function that names the step that begins."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task('', total=total)
        begun = []

        def step(name):
            bar.update(task, description=name, completed=len(begun))
            begun.append(name)

        yield step


def folder(path):
    """Return the folder `path`, made if need be, or None for None; `PkmError` if it cannot be written."""
    if path is not None:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise PkmError(f'--out: {path}: {error.strerror}') from None
    return path


def write_json(path, figures):
    """Write the nested dict `figures` to `path`, arrays as lists and NaN as null; nothing if `path` is None."""
    if path is None:
        return
    try:
        path.write_text(json.dumps(_plain(figures), indent=2, allow_nan=False) + '\n', encoding='utf-8')
    except OSError as error:
        raise PkmError(f'--json: {path}: {error.strerror}') from None


def _plain(value):
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, 'tolist'):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
