"""The examples in the docstrings of the core say what the functions do."""

import doctest
import importlib
from pathlib import Path

import numpy as np
import pytest

import pkm_core

ROOT = Path(pkm_core.__file__).parent
MODULES = [path for path in sorted(ROOT.rglob('*.py')) if '>>> ' in path.read_text(encoding='utf-8')]


@pytest.mark.parametrize('path', MODULES, ids=lambda path: path.stem)
def test_examples_of_the_docstrings_hold(path):
    name = '.'.join(['pkm_core', *path.relative_to(ROOT).with_suffix('').parts])
    failures, tried = doctest.testmod(importlib.import_module(name), extraglobs={'np': np})
    assert (failures, tried > 0) == (0, True)
