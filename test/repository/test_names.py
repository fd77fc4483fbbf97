"""The name of a test states its behaviour in at most 60 characters; the details are in its docstring."""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]
LONGEST = 60


@pytest.mark.parametrize('path', sorted(TESTS.rglob('test_*.py')), ids=lambda path: str(path.relative_to(TESTS)))
def test_names_of_tests_are_short(path):
    definitions = (ast.FunctionDef, ast.AsyncFunctionDef)
    tree = ast.parse(path.read_text(encoding='utf-8'))
    names = [node.name for node in ast.walk(tree) if isinstance(node, definitions) and node.name.startswith('test_')]
    assert [name for name in names if len(name) > LONGEST] == []
