"""What a package imports, and real processes for the pages of the docs."""

import ast
import sys

import pytest

from support.processes import processes

__all__ = ['imports_of', 'processes']


@pytest.fixture(scope='session')
def imports_of():
    """Return a function: what the package in a folder imports, but for itself and the standard library."""
    return imported


def imported(package):
    names = set()
    for path in (*(package / package.name).rglob('*.py'), *(package / 'launch').glob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names.add(node.module.partition('.')[0])
    return names - set(sys.stdlib_module_names) - {package.name}
