"""The Dockerfile and compose.yaml, read line by line: the tests need no Docker engine."""

import fnmatch
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from catkin_pkg.package import parse_package

from pkm_nodes.graph import cell_nodes

ROOT = Path(__file__).resolve().parents[2]
DOCKER = ROOT / 'docker'
PACKAGES = sorted(path.parent for path in (ROOT / 'src').glob('*/setup.py'))
# import name: distribution, where they differ or where another distribution contains the import
DISTRIBUTIONS = {
    'llvmlite': 'numba',
    'lz4': 'mcap',
    'mpl_toolkits': 'matplotlib',
    'skimage': 'scikit-image',
    'websockets': 'viser',
    'zstandard': 'mcap',
}
OF_ROS = {'yaml'}
ELSEWHERE = {'mujoco'}  # for the bench only, which reports that it is missing


def instructions():
    """Return [(instruction, arguments)] of the Dockerfile; comments dropped, continued lines joined."""
    text = re.sub(r'(?m)^\s*#.*\n', '', (DOCKER / 'Dockerfile').read_text())
    lines = re.sub(r'\\\n', ' ', text).splitlines()
    return [tuple(line.split(maxsplit=1)) for line in lines if line.strip()]


def of(kind):
    return [arguments for instruction, arguments in instructions() if instruction == kind]


def left_out(path):
    """Return whether Dockerfile.dockerignore excludes `path` (relative) from the build."""
    out = False
    for pattern in (DOCKER / 'Dockerfile.dockerignore').read_text().splitlines():
        if pattern and not pattern.startswith('#'):
            bare = pattern.removeprefix('!')
            if any(fnmatch.fnmatch(str(part), bare) for part in (path, *path.parents)):
                out = not pattern.startswith('!')
    return out


def test_every_instruction_is_known():
    known = {'FROM', 'RUN', 'COPY', 'WORKDIR', 'ENTRYPOINT', 'STOPSIGNAL', 'CMD'}
    assert {instruction for instruction, _ in instructions()} <= known
    assert instructions()[0] == ('FROM', 'ros:jazzy-ros-base')


def test_copied_files_exist_and_are_sent_to_the_build():
    assert of('COPY')
    for arguments in of('COPY'):
        *sources, _ = shlex.split(arguments)
        for source in sources:
            assert (ROOT / source).exists(), source
            files = [path.relative_to(ROOT) for path in (ROOT / source).rglob('*.py')] or [Path(source)]
            assert not any(left_out(path) for path in files if path.exists())
    assert left_out(Path('.venv'))
    assert left_out(Path('runs/first/results.json'))


@pytest.mark.parametrize('script', [*of('RUN'), (DOCKER / 'entrypoint.sh').read_text()])
def test_every_script_can_be_parsed(script):
    subprocess.run(['bash', '-n'], input=script, text=True, check=True, timeout=10)


def test_versions_in_the_image_are_those_of_the_lock(tmp_path):
    """Run the RUN line that strips the hashes; pip takes its output as constraints."""
    (strip,) = [script for script in of('RUN') if script.startswith('sed ')]
    source, target = re.findall(r'/tmp/[\w.]+', strip)
    assert f'requirements/requirements.txt {source}' in of('COPY')
    here = strip.replace(source, str(ROOT / 'requirements/requirements.txt')).replace(target, str(tmp_path / 'out'))
    subprocess.run(['bash', '-ec', here], check=True, timeout=10)
    lines = [line for line in (tmp_path / 'out').read_text().splitlines() if not line.lstrip().startswith('#')]
    assert all(re.fullmatch(r'[\w.-]+==[\w.+-]+( ; .+)?', line) for line in lines), lines
    (install,) = [script for script in of('RUN') if 'pip install' in script]
    assert f'--constraint {target}' in install
    _, _, packages = install.partition(target)
    locked = {line.partition('==')[0] for line in lines}
    assert set(shlex.split(packages)) <= locked


def test_image_stops_by_sigint():
    """SIGINT lets ros2 launch end its nodes; SIGTERM does not."""
    assert of('STOPSIGNAL') == ['SIGINT']


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_every_import_is_installed_in_the_image(package, imports_of):
    installed = {word for line in of('RUN') for word in shlex.split(line)}
    declared = {dependency.name for dependency in parse_package(str(package)).exec_depends}
    for name in imports_of(package) - OF_ROS - ELSEWHERE:
        assert name in declared or DISTRIBUTIONS.get(name, name) in installed, name


def test_default_command_launches_with_existing_arguments():
    (command,) = of('CMD')
    *words, package, file, argument = yaml.safe_load(command)
    assert (words, package) == (['ros2', 'launch'], 'pkm_nodes')
    launch = (ROOT / 'src' / package / 'launch' / file).read_text()
    assert f"DeclareLaunchArgument('{argument.partition(':=')[0]}'" in launch


def test_entry_point_is_copied_and_executable():
    (entry,) = of('ENTRYPOINT')
    (path,) = yaml.safe_load(entry)
    assert f'docker/entrypoint.sh {path}' in of('COPY')
    assert (DOCKER / 'entrypoint.sh').stat().st_mode & 0o111


def test_services_are_the_nodes_of_a_cell():
    written = (DOCKER / 'compose.yaml').read_text()
    program = [sys.executable, DOCKER / 'compose.py']
    wanted = subprocess.run(program, capture_output=True, text=True, check=True, timeout=60).stdout
    assert written == wanted, 'outdated: run .venv/bin/python docker/compose.py > docker/compose.yaml'
    services = yaml.safe_load(written)['services']
    assert list(services) == [spec.name for spec in cell_nodes('four_dof')]
    for service in services.values():
        assert all(isinstance(word, str) for word in service['command'])
        assert service['environment']['ROS_SECURITY_KEYSTORE'] == '/keystore'
        assert any(volume.endswith(':/runs') for volume in service['volumes'])


def test_services_share_memory_and_stop_by_sigint():
    services = yaml.safe_load((DOCKER / 'compose.yaml').read_text())['services']
    assert {name: service['ipc'] for name, service in services.items()} == {
        name: 'shareable' if name == 'machine' else 'service:machine' for name in services
    }
    assert {service['stop_signal'] for service in services.values()} == {'SIGINT'}
    build = services['machine']['build']
    assert (DOCKER / build['context'] / build['dockerfile']).resolve() == DOCKER / 'Dockerfile'
