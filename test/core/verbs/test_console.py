"""Tables and progress bars as they appear on a terminal of 80 columns."""

from io import StringIO

import numpy as np
import pytest

from pkm_core.reporting.tables import Table
from pkm_core.verbs.console import Output, progress_bar, progress_bars, report_table, table


@pytest.fixture
def console():
    return Output(file=StringIO(), width=80)


def printed(console):
    return console.file.getvalue()


def test_square_brackets_of_units_are_printed(console):
    console.print(table('error [um]', ['axis [1]', 'worst\n[um]'], [('d1 [a]', '2.5')], caption='[all]'))
    for text in ('error [um]', 'axis [1]', '[um]', 'd1 [a]', '[all]'):
        assert text in printed(console)


def test_columns_are_justified_as_asked(console):
    console.print(table('', ['name', 'value', 'note'], [('a', '1', 'x'), ('long', '22222', 'note')], align='lrl'))
    row = next(line for line in printed(console).splitlines() if line.startswith('│ a'))
    assert row == '│ a    │     1 │ x    │'


def test_none_draws_a_line_below_the_row_before(console):
    console.print(table('', ['a'], [('1',), None, ('2',)]))
    lines = printed(console).splitlines()
    assert lines[lines.index('│ 1 │') + 1] == '├───┤'


def test_table_of_a_report_has_its_rows(console):
    console.print(report_table(Table('made', ['axis', 'K [1/s]'], [['d1', '3.0']]), wide=False))
    assert 'K [1/s]' in printed(console)
    assert 'd1' in printed(console)
    assert '│' not in printed(console)


def test_kept_bars_show_steps_done(console):
    with progress_bars(console, ['d1', 'd3'], 4, keep=True) as (first, second):
        first.show(3)
        for name in ('fit', 'figures'):
            second.step(name)
    lines = printed(console).splitlines()
    assert any(line.startswith('d1 ') and '3/4' in line for line in lines)
    assert any(line.startswith('figures ') and '1/4' in line for line in lines)


def test_bar_of_a_share_shows_percent(console):
    with progress_bar(console, name='starting', keep=True) as bar:
        bar.show(0.25, 'd1 [sweep]')
    assert 'd1 [sweep]' in printed(console)
    assert '25%' in printed(console)


def test_bar_that_is_not_kept_leaves_nothing(console):
    with progress_bar(console, 3) as bar:
        bar.step('one')
    assert not printed(console).strip()


def test_plain_text_is_neither_wrapped_nor_markup(console):
    console.plain('[red]' + 'x' * 100)
    assert printed(console) == '[red]' + 'x' * 100 + '\n'


@pytest.mark.parametrize('is_terminal', [True, False])
def test_no_digit_is_cut_in_any_narrow_terminal(is_terminal):
    """Tables of random shapes, 20 to 80 columns: every word of every cell is there, and no ellipsis."""
    rng = np.random.default_rng(7)
    for width in range(20, 81, 4):
        count = int(rng.integers(1, 9))
        headings = [' '.join(['error', 'largest', '[um]'][: rng.integers(1, 4)]) for _ in range(count)]
        rows = [[_cell(rng) for _ in range(count)] for _ in range(3)]
        console = Output(file=StringIO(), width=width, force_terminal=is_terminal, color_system=None)
        console.print(table('made', headings, rows, no_wrap=bool(rng.integers(2)), wide=bool(rng.integers(2))))
        words = printed(console).replace('│', ' ').split()
        assert all(word in words for row in rows for cell in row for word in cell.split()), (width, rows)
        assert '…' not in printed(console)


def _cell(rng):
    """Return a number, two numbers or a text of several words."""
    number = f'{rng.normal(scale=10.0 ** rng.integers(0, 6)):.{rng.integers(0, 6)}f}'
    return [number, f'{number} -> {rng.normal():.2f}', 'converges on all models'][rng.integers(3)]


def test_table_wider_than_the_terminal_becomes_a_list():
    console = Output(file=StringIO(), width=20, force_terminal=True, color_system=None)
    console.print(table('error [um]', ['axis', 'largest\n[um]', 'rest'], [('d1 [a]', '123456.789', '0.25')]))
    assert printed(console) == 'error [um]\n\naxis: d1 [a]\nlargest [um]: 123456.789\nrest: 0.25\n\n'


def test_narrow_terminal_shows_every_digit_of_a_table():
    console = Output(file=StringIO(), width=30)
    numbers = [f'{number}.123456' for number in range(10, 18)]
    console.print(table('wide', [f'column {number}' for number in numbers], [numbers]))
    assert all(f' {number} ' in printed(console) for number in numbers)
    assert console.width == 30
