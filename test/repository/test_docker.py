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
    known = {'ARG', 'FROM', 'RUN', 'COPY', 'WORKDIR', 'ENV', 'USER', 'ENTRYPOINT', 'STOPSIGNAL', 'CMD'}
    assert {instruction for instruction, _ in instructions()} <= known
    assert instructions()[:2] == [('ARG', 'BASE=ros:jazzy-ros-base'), ('FROM', '${BASE}')]


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


def test_packages_of_the_image_are_locked_with_hashes():
    """Every package has the version of the lock of this project; pip refuses a file without a listed hash."""
    (install,) = [script for script in of('RUN') if 'pip install' in script]
    assert '--require-hashes --requirement /tmp/image.txt' in install
    assert 'requirements/image.txt /tmp/image.txt' in of('COPY')
    image, project = (pins(name) for name in ('image', 'requirements'))
    assert {name: image[name] for name in image if name in project} == {
        name: project[name] for name in image if name in project
    }
    assert set(image) >= asked()
    text = (ROOT / 'requirements/image.txt').read_text()
    assert all(line.endswith('\\') for line in text.splitlines() if '==' in line), 'hashes follow every pin'


def pins(name):
    """Return {distribution: version} of a lock file."""
    text = (ROOT / f'requirements/{name}.txt').read_text()
    return dict(re.findall(r'(?m)^([\w.-]+)==([\w.+-]+)', text))


def asked():
    """Return the distributions that the image is to have."""
    lines = (ROOT / 'requirements/image.in').read_text().splitlines()
    return {line for line in lines if line and line[0] not in '#-'}


def test_image_and_services_do_not_run_as_root():
    (user,) = of('USER')
    assert int(user.partition(':')[0]) > 0
    services = yaml.safe_load((DOCKER / 'compose.yaml').read_text())['services']
    for service in services.values():
        assert service['user'] == f'${{PKM_USER:-{user}}}'
        assert service['cap_drop'] == ['ALL']


def test_image_stops_by_sigint():
    """SIGINT lets ros2 launch end its nodes; SIGTERM does not."""
    assert of('STOPSIGNAL') == ['SIGINT']


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_every_import_is_installed_in_the_image(package, imports_of):
    installed = asked()
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
