"""
The three ROS packages as ament and rosdep read them: faults that would stop colcon or a release build.

The linters of ament need an installed ROS. ruff checks what ament_flake8 and ament_pep257 check (pyproject.toml), mypy
what ament_mypy checks. test_docker.py tests the dependencies that the image installs.
"""

import ast
import configparser
import os
import re
import runpy
import subprocess
import sys
from importlib import metadata
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
PACKAGE_SCRIPTS = [*(path / 'setup.py' for path in PYTHON_PACKAGES), INTERFACES / 'CMakeLists.txt']
SCRIPTS = [*sorted((ROOT / 'bringup_scripts').iterdir()), ROOT / '.ci' / 'run', ROOT / 'docker' / 'entrypoint.sh']
# rosdep's keys, where they are not python3-NAME
KEYS = {'python3-yaml': 'yaml', 'python3-skimage': 'skimage', 'python3-trimesh-pip': 'trimesh'}
# from PyPI: rosdep has no key or too old a version; the image installs them with pip, see test_docker.py
WITHOUT_KEY = {
    'control',
    'distributed',
    'llvmlite',
    'lz4',
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


def by_path(path):
    return str(path.relative_to(ROOT))


@pytest.fixture(params=PYTHON_PACKAGES, ids=by_name)
def package(request):
    return request.param


@pytest.fixture
def setup(package, monkeypatch):
    """Return the keyword arguments of the call of `setuptools.setup` in setup.py."""
    arguments = {}
    monkeypatch.setattr(setuptools, 'setup', lambda **keywords: arguments.update(keywords))
    monkeypatch.chdir(package)
    runpy.run_path('setup.py')
    return arguments


def test_setup_has_the_metadata_of_the_manifest(package, setup):
    manifest = parse_package(str(package))
    (maintainer,), (license_,) = manifest.maintainers, manifest.licenses
    expected = {'name': manifest.name, 'version': manifest.version, 'description': manifest.description}
    expected |= {'license': license_, 'maintainer': maintainer.name, 'maintainer_email': maintainer.email}
    assert {key: setup[key] for key in expected} == expected


@pytest.mark.parametrize('package', PACKAGES, ids=by_name)
def test_manifest_is_valid_and_names_its_folder(package):
    faults = []
    manifest = parse_package(str(package), warnings=faults)
    assert not faults
    assert manifest.name == package.name
    assert manifest.get_build_type() == ('ament_python' if package in PYTHON_PACKAGES else 'ament_cmake')


def test_version_is_the_same_everywhere():
    """The manifests are the source; the installed packages, `pkm --version` and the changelog agree with them."""
    (version,) = {parse_package(str(package)).version for package in PACKAGES}
    assert metadata.version('pkm_core') == metadata.version('pkm_nodes') == version
    program = [Path(sys.prefix) / 'bin' / 'pkm', '--version']
    assert subprocess.run(program, capture_output=True, text=True, check=True, timeout=60).stdout == f'{version}\n'
    changelog = (ROOT / 'CHANGELOG.md').read_text(encoding='utf-8')
    assert re.search(r'^## \[(.+?)\]', changelog, re.MULTILINE)[1] == version


def test_version_is_written_in_the_manifests_alone():
    for path in [*(ROOT / 'src').rglob('*.py'), ROOT / 'pyproject.toml']:
        assert not re.search(r'version(__)? *= *[\'"]\d+\.\d+\.\d+', path.read_text(encoding='utf-8')), path


@pytest.mark.parametrize('package', PACKAGES, ids=by_name)
def test_licence_is_named_as_in_the_licence_file(package):
    """`Apache-2.0` is the SPDX identifier of the text in LICENSE."""
    assert parse_package(str(package)).licenses == ['Apache-2.0']
    title, version = (ROOT / 'LICENSE').read_text(encoding='utf-8').split('\n')[1:3]
    assert (title.strip(), version.strip()) == ('Apache License', 'Version 2.0, January 2004')


@pytest.mark.parametrize('path', [*PACKAGE_SCRIPTS, *SCRIPTS], ids=by_path)
def test_build_files_and_scripts_have_an_spdx_line(path):
    assert '# SPDX-License-Identifier: Apache-2.0' in path.read_text(encoding='utf-8').splitlines()[:2]


def test_package_and_executables_are_found_by_ros2(package, setup):
    """The ament index lists the package; `ros2 run` looks for executables in lib/PACKAGE."""
    installed = dict(setup['data_files'])
    marker = f'resource/{package.name}'
    assert installed['share/ament_index/resource_index/packages'] == [marker]
    assert (package / marker).read_text() == ''
    assert installed[f'share/{package.name}'] == ['package.xml']
    scripts = configparser.ConfigParser()
    scripts.read(package / 'setup.cfg')
    assert scripts['develop']['script_dir'] == scripts['install']['install_scripts'] == f'$base/lib/{package.name}'


def test_data_files_are_installed(package, setup):
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
            functions = {node.name for node in code.body if isinstance(node, ast.FunctionDef)}
            made = [target for node in code.body if isinstance(node, ast.Assign) for target in node.targets]
            assert function in functions | {target.id for target in made if isinstance(target, ast.Name)}, entry


def test_manifest_declares_exactly_what_the_code_imports(package, imports_of):
    dependencies = [dependency.name for dependency in parse_package(str(package)).exec_depends]
    declared = {KEYS.get(name, name.removeprefix('python3-')) for name in dependencies}
    assert len(declared) == len(dependencies)
    assert declared == imports_of(package) - WITHOUT_KEY


def test_every_interface_is_built():
    listed = re.findall(r'"(\w+/\w+\.\w+)"', (INTERFACES / 'CMakeLists.txt').read_text())
    assert sorted(listed) == sorted(str(path.relative_to(INTERFACES)) for path in INTERFACE_FILES)


@pytest.mark.parametrize('path', INTERFACE_FILES, ids=by_name)
def test_every_number_of_an_interface_has_a_unit(path):
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


@pytest.mark.parametrize('path', SCRIPTS, ids=by_path)
def test_scripts_are_executable_and_name_their_interpreter(path):
    assert os.access(path, os.X_OK)
    assert re.match(r'#!(/usr/bin/env |/bin/)bash\n', path.read_text(encoding='utf-8'))
