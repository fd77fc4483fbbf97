"""The examples in the docstrings of the design tools say what the tools do."""

import doctest
import importlib
import pkgutil

import numpy as np
import pytest

import pkm_core.design

MODULES = [f'pkm_core.design.{module.name}' for module in pkgutil.iter_modules(pkm_core.design.__path__)]


@pytest.mark.parametrize('name', MODULES)
def test_examples_of_the_docstrings_hold(name):
    failures, _ = doctest.testmod(importlib.import_module(name), extraglobs={'np': np})
    assert failures == 0
