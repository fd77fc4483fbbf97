"""The public face: which names there are, that they come late, and that docs/api.md is theirs."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import pkm_core as pkm
from pkm_core.api import page

ROOT = Path(__file__).resolve().parents[3]
STUB = Path(pkm.__file__).with_suffix('.pyi')
FUNCTIONS = [name for name in pkm.__all__ if inspect.isfunction(getattr(pkm, name))]
CLASSES = [
    name
    for name in pkm.__all__
    if inspect.isclass(getattr(pkm, name)) and getattr(pkm, name).__module__.startswith('pkm_core.api')
]


def run_python(program):
    return subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=True).stdout


def test_import_loads_nothing_heavy():
    """Every node and every verb imports pkm_core."""
    loaded = run_python('import sys, pkm_core; print(*sys.modules)').split()
    assert not {'numpy', 'scipy', 'numba', 'matplotlib', 'control', 'pkm_core.api'} & set(loaded)


def test_a_name_loads_only_what_it_needs():
    loaded = run_python('import sys, pkm_core; pkm_core.load_machine; print(*sys.modules)').split()
    assert 'pkm_core.api.motions' in loaded
    assert not {'control', 'pandas', 'matplotlib.pyplot', 'rclpy', 'pkm_core.api.identification'} & set(loaded)


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match=r"module 'pkm_core' has no attribute 'simulation_of'"):
        _ = pkm.simulation_of


def test_stub_exports_the_names_there_are():
    """Type checkers read the stub; a name missing there would be missing for them."""
    tree = ast.parse(STUB.read_text(encoding='utf-8'))
    (exported,) = [node.value for node in tree.body if isinstance(node, ast.Assign)]
    imported = {alias.name for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert set(ast.literal_eval(exported)) == imported == set(pkm.__all__)


def test_stub_names_the_modules_of_the_names():
    tree = ast.parse(STUB.read_text(encoding='utf-8'))
    modules = {
        alias.name: node.module for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert {name: f'pkm_core.{module}' for name, module in pkm._MODULES.items()} == modules


@pytest.mark.parametrize('name', FUNCTIONS)
def test_function_has_types_and_a_whole_docstring(name):
    function = getattr(pkm, name)
    signature, text = inspect.signature(function), inspect.getdoc(function)
    assert all(each.annotation is not each.empty for each in signature.parameters.values())
    assert signature.return_annotation is not signature.empty
    for section in ('Parameters\n', 'Raises\n', 'Examples\n', '>>> '):
        assert section in text
    for parameter in signature.parameters:
        assert parameter in text.partition('Parameters\n')[2]


@pytest.mark.parametrize('name', CLASSES)
def test_class_documents_its_fields_and_has_an_example(name):
    kind, text = getattr(pkm, name), inspect.getdoc(getattr(pkm, name))
    assert '>>> ' in text
    for field in getattr(kind, '__dataclass_fields__', ()):
        assert field in text.partition('Attributes\n')[2]


def test_page_is_generated_from_the_docstrings():
    """Renew it with: .venv/bin/python -m pkm_core.api.page > docs/api.md."""
    assert (ROOT / 'docs' / 'api.md').read_text(encoding='utf-8') == page.page()


def test_page_has_every_name():
    assert sorted(name for names in page.GROUPS.values() for name in names) == sorted(pkm.__all__)


@pytest.mark.slow  # mypy starts without a cache
def test_type_checker_sees_the_types_of_the_library(tmp_path):
    program = tmp_path / 'user.py'
    program.write_text(
        "import pkm_core as pkm\npkm.simulate(pkm.load_machine('planar'), cycles='two').plot().savefig(1)\n"
    )
    command = [sys.executable, '-m', 'mypy', '--strict', '--config-file=', '--follow-imports=silent', str(program)]
    said = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path).stdout
    assert 'Argument "cycles" to "simulate" has incompatible type "str"; expected "int"' in said
    assert 'Argument 1 to "savefig" of "Figure" has incompatible type "int"' in said
    assert said.count('error:') == 2, said
