"""
Tells at the end of the tests, by package, which lines they have executed, when `coverage run` watches them.

Counted is what ran in the process of the tests: nodes in processes of their own and compiled loops do not show.
"""

from collections import defaultdict
from pathlib import Path

import coverage

SOURCES = {'pkm_core': Path('src/pkm_core'), 'pkm_nodes': Path('src/pkm_nodes')}


def shares(data):
    """Return {package: [lines, lines executed]} of a `coverage.Coverage`."""
    counted = defaultdict(lambda: [0, 0])
    for name, source in SOURCES.items():
        for path in sorted((source / name).rglob('*.py')):
            _, lines, _, missing, _ = data.analysis2(str(path.resolve()))
            package = '.'.join(path.relative_to(source).parts[:-1])
            for key in {package, f'{name}, all of it'}:
                counted[key][0] += len(lines)
                counted[key][1] += len(lines) - len(missing)
    return counted


def pytest_terminal_summary(terminalreporter):
    """Write the table before pytest's closing line."""
    data = coverage.Coverage.current()
    if data is None:
        return
    data.stop()
    terminalreporter.section('lines run by the tests in this process')
    for package, (lines, run) in sorted(shares(data).items()):
        if lines:
            terminalreporter.line(f'{package:30} {lines:6} lines {100.0 * run / lines:4.0f} %')
