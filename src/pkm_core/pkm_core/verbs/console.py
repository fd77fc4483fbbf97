"""Terminal output of the verbs: tables, progress bars, warnings. No other module of the verbs sets up rich."""

from contextlib import contextmanager

from rich.box import HEAVY_HEAD, SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table
from rich.text import Text

from pkm_core.interrupts import interruptible

# [characters] of an output that is no terminal, as of a pipe or a file: a table is as wide as its words need
_USUAL_WIDTH = 80


class Output(Console):
    """The terminal, with what verbs print on it."""

    def print(self, *objects, **options):
        """
        Print as `Console.print` does, but no word of a table is ever cut: its columns get at least their longest word.

        A table that is wider than the terminal is printed as a list, one line per cell. In a pipe or a file it stays a
        table, as wide as it needs to be.
        """
        for each in objects:
            if isinstance(each, Table):
                self._print_table(each, options)
        others = [each for each in objects if not isinstance(each, Table)]
        if others or not objects:
            super().print(*others, **options)

    def _print_table(self, made, options):
        least = column_widths(self, made, self.width)
        needed = sum(least) + _extra_width(made)
        if needed > self.width and self.is_terminal:
            for line in _as_list(made):
                super().print(line, soft_wrap=True, markup=False, highlight=False)
            return
        before = self.width
        for column, width in zip(made.columns, column_widths(self, made, max(needed, before)), strict=True):
            column.width = width
        self.width = max(needed, before)
        try:
            super().print(made, **options)
        finally:
            self.width = before

    def plain(self, text):
        """Print `text` as it is: not wrapped, square brackets included."""
        self.print(text, soft_wrap=True, markup=False)

    def warnings(self, texts):
        """Print one line per warning."""
        for text in texts:
            self.print(f'[yellow]warning:[/yellow] {escape(text)}', soft_wrap=True, highlight=False)


def table(title, headings, rows=(), *, align='lr', wide=True, caption=None, **options):
    """
    Return a rich table of plain text: square brackets, as of units, are printed.

    Parameters
    ----------
    title : str
        Printed above it, left-justified.
    headings : iterable of str
        One per column.
    rows : iterable of (iterable of str or None)
        Cells of each row; None draws a line below the row before it.
    align : str
        'l' or 'r' per column: left- or right-justified; the last letter holds for all columns after it.
    wide : bool
        Whether it has lines between its columns; without them it is two characters per column narrower.
    caption : str, optional
        Printed below it, left-justified.
    **options
        Of every column, such as ``no_wrap=True``.

    """
    below = None if caption is None else escape(caption)
    style = {'box': HEAVY_HEAD} if wide else {'box': SIMPLE_HEAD, 'padding': (0, 1, 0, 0)}
    made = Table(title=escape(title), title_justify='left', caption=below, caption_justify='left', **style)
    for number, heading in enumerate(headings):
        letter = align[min(number, len(align) - 1)]
        made.add_column(escape(heading), justify='left' if letter == 'l' else 'right', **options)
    for row in rows:
        if row is None:
            made.add_section()
        else:
            made.add_row(*map(escape, row))
    return made


def column_widths(console, made, width):
    """
    Return the widths of the columns of the rich table `made` without padding, for a line of `width` characters.

    A column is at least as wide as its longest word; what is left of the line goes to the columns with longer texts,
    the narrowest first.
    """
    wide = console.options.update(width=1000)
    cells = [[column.header, *column.cells] for column in made.columns]
    sizes = [[Measurement.get(console, wide, cell) for cell in column] for column in cells]
    least = [
        max(size.maximum if column.no_wrap else size.minimum for size in of_column)
        for column, of_column in zip(made.columns, sizes, strict=True)
    ]
    most = [max(size.maximum for size in of_column) for of_column in sizes]
    left = width - _extra_width(made) - sum(least)
    for number in sorted(range(len(least)), key=lambda number: most[number] - least[number]):
        added = max(0, min(left, most[number] - least[number]))
        least[number] += added
        left -= added
    return least


def _extra_width(made):
    """Return how many characters of a line are borders and padding of the columns of `made`."""
    _, right, _, left = made.padding
    lines = len(made.columns) + 1 if made.box else 0
    return len(made.columns) * (left + right) + lines


def _as_list(made):
    """Return the lines of the table `made` as a list: its title, then one line `heading: cell` per cell."""
    plain = [[Text.from_markup(str(cell)).plain for cell in column.cells] for column in made.columns]
    headings = [' '.join(Text.from_markup(str(column.header)).plain.split()) for column in made.columns]
    lines = [Text.from_markup(str(made.title)).plain] if made.title else []
    for row in zip(*plain, strict=True):
        lines += ['', *(f'{heading}: {cell}' if heading else cell for heading, cell in zip(headings, row, strict=True))]
    return [*lines, '', *([Text.from_markup(str(made.caption)).plain] if made.caption else [])]


def report_table(report, **options):
    """Return the rich table of a `reporting.tables.Table`; `options` as for `table`."""
    return table(report.title, report.headings, report.rows, **options)


class Bar:
    """One line of a progress display: a name and how much is done."""

    def __init__(self, display, name, total):
        self._display = display
        self._task = display.add_task(escape(name), total=total)
        self._begun = 0

    def show(self, done=None, name=None):
        """Show `done`, in steps or as a share, and `name`; None leaves what is shown."""
        changed = {'completed': done, 'description': None if name is None else escape(name)}
        self._display.update(self._task, **{key: value for key, value in changed.items() if value is not None})

    def step(self, name):
        """Begin the step `name`; all steps begun before are done."""
        self.show(self._begun, name)
        self._begun += 1


@contextmanager
def progress_bars(console, names, total=None, *, keep=False):
    """
    Show one bar per name while the block runs and yield the list of `Bar`s.

    Parameters
    ----------
    console : Output
        Where they are shown.
    names : iterable of str
        First text of each bar.
    total : int, optional
        Number of steps of each; without it a bar shows a share from 0 to 1 in percent.
    keep : bool
        Whether the bars stay on the terminal afterwards.

    """
    share = TaskProgressColumn() if total is None else MofNCompleteColumn()
    columns = (TextColumn('{task.description}'), BarColumn(), share, TimeElapsedColumn())
    with interruptible(), Progress(*columns, console=console, transient=not keep) as display:  # it restores the cursor
        yield [Bar(display, name, 1.0 if total is None else total) for name in names]


@contextmanager
def progress_bar(console, total=None, *, name='', keep=False):
    """Show one bar, as `progress_bars` does, and yield the `Bar`."""
    with progress_bars(console, [name], total, keep=keep) as [bar]:
        yield bar
