"""
The three ROS packages as ament and rosdep see them: what colcon and a release build would stumble over.

ament's own linters need an installed ROS; what ament_flake8 and ament_pep257 look at, ruff does (pyproject.toml), and
ament_mypy's part is mypy's. The image's side of the dependencies is in test_docker.py.
"""

import ast
import configparser
import os
import re
import runpy
from pathlib import Path
from xml.etree import ElementTree

import pytest
import setuptools
from catkin_pkg.package import parse_package

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent for path in (ROOT / 'src').glob('*/package.xml'))
PYTHON_PACKAGES = [path for path in PACKAGES if (path / 'setup.py').exists()]
INTERFACES = ROOT / 'src' / 'pkm_interfaces'
INTERFACE_FILES = [path for kind in ('msg', 'srv', 'action') for path in INTERFACES.glob(f'{kind}/*')]
# rosdep's keys, where they are not python3-NAME
KEYS = {'python3-yaml': 'yaml', 'python3-skimage': 'skimage', 'python3-trimesh-pip': 'trimesh'}
# of PyPI, without a key of rosdep or only in too old a version: the image installs them with pip, see test_docker.py
WITHOUT_KEY = {
    'control',
    'distributed',
    'llvmlite',
    'mcap',
    'mcap_ros2',
    'mpl_toolkits',
    'mujoco',
    'pymoo',
    'rich',
    'rosbags',
}
WITHOUT_KEY |= {'ruckig', 'typer', 'viser', 'websockets', 'zstandard'}


def by_name(path):
    return path.name


@pytest.fixture(params=PYTHON_PACKAGES, ids=by_name)
def package(request):
    return request.param


@pytest.fixture
def setup(package, monkeypatch):
    """Return what setup.py tells setuptools, by keyword."""
    told = {}
    monkeypatch.setattr(setuptools, 'setup', lambda **keywords: told.update(keywords))
    monkeypatch.chdir(package)
    runpy.run_path('setup.py')
    return told


def test_setup_says_what_the_manifest_says(package, setup):
    manifest = parse_package(str(package))
    (maintainer,), (license_,) = manifest.maintainers, manifest.licenses
    said = {'name': manifest.name, 'version': manifest.version, 'description': manifest.description}
    said |= {'license': license_, 'maintainer': maintainer.name, 'maintainer_email': maintainer.email}
    assert {key: setup[key] for key in said} == said


@pytest.mark.parametrize('package', PACKAGES, ids=by_name)
def test_manifest_is_without_fault_and_of_the_folder_it_lies_in(package):
    faults = []
    manifest = parse_package(str(package), warnings=faults)
    assert not faults
    assert (manifest.name, manifest.version) == (package.name, '0.1.0')
    assert manifest.get_build_type() == ('ament_python' if package in PYTHON_PACKAGES else 'ament_cmake')


def test_package_is_found_in_the_ament_index_and_its_executables_by_ros2_run(package, setup):
    installed = dict(setup['data_files'])
    marker = f'resource/{package.name}'
    assert installed['share/ament_index/resource_index/packages'] == [marker]
    assert (package / marker).read_text() == ''
    assert installed[f'share/{package.name}'] == ['package.xml']
    scripts = configparser.ConfigParser()
    scripts.read(package / 'setup.cfg')
    assert scripts['develop']['script_dir'] == scripts['install']['install_scripts'] == f'$base/lib/{package.name}'


def test_everything_beside_the_code_is_installed(package, setup):
    installed = {path for _, files in setup['data_files'] for path in files}
    inside = {f'{name}/{file}' for name, files in setup.get('package_data', {}).items() for file in files}
    paths = (Path(folder) / name for folder, _, names in os.walk(package, followlinks=True) for name in names)
    beside = {path.relative_to(package) for path in paths if path.suffix not in ('.py', '.cfg')}
    for path in beside:
        assert str(path) in installed | inside or '__pycache__' in path.parts


def test_entry_points_lead_to_functions(package, setup):
    for entries in setup['entry_points'].values():
        for entry in entries:
            module, _, function = entry.partition('=')[2].strip().partition(':')
            code = ast.parse((package / Path(*module.split('.'))).with_suffix('.py').read_text(encoding='utf-8'))
            assert function in {node.name for node in code.body if isinstance(node, ast.FunctionDef)}, entry


def test_manifest_declares_what_the_code_imports_and_nothing_else(package, imports_of):
    dependencies = [dependency.name for dependency in parse_package(str(package)).exec_depends]
    declared = {KEYS.get(name, name.removeprefix('python3-')) for name in dependencies}
    assert len(declared) == len(dependencies)
    assert declared == imports_of(package) - WITHOUT_KEY


def test_every_interface_is_built():
    listed = re.findall(r'"(\w+/\w+\.\w+)"', (INTERFACES / 'CMakeLists.txt').read_text())
    assert sorted(listed) == sorted(str(path.relative_to(INTERFACES)) for path in INTERFACE_FILES)


@pytest.mark.parametrize('path', INTERFACE_FILES, ids=by_name)
def test_every_number_of_an_interface_has_its_unit_beside_it(path):
    text = path.read_text(encoding='utf-8')
    enumerations = {kind for kind, _ in re.findall(r'^(\w+) ([A-Z_]+)=', text, re.MULTILINE)}
    for kind, rest in re.findall(r'^((?:float|u?int)\d+)(?:\[\d*\])?\s+(.*)$', text, re.MULTILINE):
        if '=' not in rest and kind not in enumerations:
            assert re.search(r'# .*\[[^\]]+\]', rest), f'{path.name}: {kind} {rest}'


@pytest.mark.parametrize(
    'path', [path for suffix in ('xml', 'urdf') for path in (ROOT / 'src').rglob(f'*.{suffix}')], ids=by_name
)
def test_xml_is_well_formed(path):
    ElementTree.parse(path)


@pytest.mark.parametrize('path', sorted((ROOT / 'bringup_scripts').iterdir()), ids=by_name)
def test_scripts_may_be_run_and_say_by_whom(path):
    assert os.access(path, os.X_OK)
    assert path.read_text(encoding='utf-8').startswith('#!/usr/bin/env ')
