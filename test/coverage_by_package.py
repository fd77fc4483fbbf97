"""
Prints, by package, what the tests that `coverage run` watched have executed; `bringup_scripts/test` ends with it.

Counted is what ran in the process of the tests: nodes in processes of their own and compiled loops do not show.
"""

from collections import defaultdict
from pathlib import Path

import coverage
from rich.console import Console
from rich.table import Table

SOURCES = {'pkm_core': Path('src/pkm_core'), 'pkm_nodes': Path('src/pkm_nodes')}


def shares():
    """Return {package: [lines, lines executed]} of .coverage in the working folder."""
    data = coverage.Coverage()
    data.load()
    counted = defaultdict(lambda: [0, 0])
    for name, source in SOURCES.items():
        for path in sorted((source / name).rglob('*.py')):
            _, lines, _, missing, _ = data.analysis2(str(path.resolve()))
            package = '.'.join(path.relative_to(source).parts[:-1])
            for key in {package, f'{name}, all of it'}:
                counted[key][0] += len(lines)
                counted[key][1] += len(lines) - len(missing)
    return counted


def main():
    """Print the table."""
    table = Table(title='lines run by the tests in this process')
    table.add_column('package')
    table.add_column('lines', justify='right')
    table.add_column('run \\[%]', justify='right')
    for package, (lines, run) in sorted(shares().items()):
        if lines:
            table.add_row(package, str(lines), f'{100.0 * run / lines:.0f}')
    Console().print(table)


if __name__ == '__main__':
    main()
