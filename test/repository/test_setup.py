"""bringup_scripts/setup: no work if already done; one line of error for a missing prerequisite."""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOOLS = [
    *('bash', 'dirname', 'readlink', 'cat', 'find', 'sort', 'xargs', 'sha256sum'),
    *('cut', 'uname', 'awk', 'mkdir', 'tail'),
]


@pytest.fixture
def fresh(tmp_path):
    """Return a function that runs the set-up of a new tree with only the given programs on PATH."""
    tree, programs = tmp_path / 'tree', tmp_path / 'bin'
    programs.mkdir()
    for folder in ('bringup_scripts', 'requirements', 'src'):
        shutil.copytree(ROOT / folder, tree / folder, symlinks=True, ignore=shutil.ignore_patterns('__pycache__'))
    for name in TOOLS:
        (programs / name).symlink_to(shutil.which(name))

    def run(**shims):
        for name, script in shims.items():
            path = programs / name.replace('cxx', 'c++')
            path.write_text(f'#!{shutil.which("bash")}\n{script}\n')
            path.chmod(0o755)
        return subprocess.run(
            [tree / 'bringup_scripts' / 'setup'],
            env={'PATH': str(programs), 'HOME': str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )

    return run


PYTHON = 'exit 0'  # stands for a supported Python
OLD_PYTHON = 'if [ "$1" = --version ]; then echo Python 3.9.2; fi; exit 1'
COMPILER = 'exit 0'
ROOM = 'echo Filesystem 1M-blocks Used Available; echo /dev/vda 9000 1 9000'
NO_ROOM = 'echo Filesystem 1M-blocks Used Available; echo /dev/vda 9000 8900 100'


@pytest.mark.parametrize(
    ('shims', 'line'),
    [
        ({'python3': PYTHON, 'df': ROOM}, 'setup: needs a C++ compiler to build pkm_interfaces; install g++'),
        ({'python3': OLD_PYTHON, 'cxx': COMPILER, 'df': ROOM}, 'setup: needs Python 3.11, 3.12 or 3.13 on PATH'),
        ({'python3': PYTHON, 'cxx': COMPILER, 'df': NO_ROOM}, 'setup: needs 2500 MB of free disk'),
    ],
)
def test_missing_prerequisite_gives_one_line_with_the_remedy(fresh, shims, line):
    done = fresh(**shims)
    assert done.returncode == 1
    assert done.stderr.startswith(line)
    assert done.stderr.count('\n') == 1


def test_second_run_of_setup_does_nothing():
    done = subprocess.run([ROOT / 'bringup_scripts' / 'setup'], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == done.stderr == ''


def test_lock_files_hash_every_package_and_name_no_registry():
    for name in ('requirements.txt', 'uv.txt'):
        text = (ROOT / 'requirements' / name).read_text()
        assert '://' not in text
        pinned = [line for line in text.splitlines() if '==' in line]
        assert pinned
        assert all(line.rstrip().endswith('\\') for line in pinned), 'hashes follow every pin'
