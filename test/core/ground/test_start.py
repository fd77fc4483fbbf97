"""Environments of a process: output that cannot be written, a deleted folder, another ROS on the import path."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PKM = Path(sys.prefix) / 'bin' / 'pkm'
COMMAND = f"'{PKM}' margins"


def shell(script, **environment):
    """Run a shell script; `$PKM` is a verb that prints a table."""
    return subprocess.run(
        ['bash', '-c', script.replace('$PKM', COMMAND)],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(
    ('script', 'code', 'said'),
    [
        ('$PKM > /dev/full', 1, 'pkm: output: No space left on device\n'),
        ('$PKM >&-', 0, ''),
        ('set -o pipefail; $PKM | true', 1, ''),
    ],
    ids=['full disk', 'closed output', 'closed pipe'],
)
def test_lost_output_gives_at_most_one_line(script, code, said):
    done = shell(script)
    assert (done.returncode, done.stderr) == (code, said)


def test_ascii_output_has_every_number():
    whole, ascii_only = shell('$PKM').stdout, shell('$PKM', PYTHONIOENCODING='ascii', LANG='C').stdout
    assert ascii_only.isascii()
    assert '1.75' in ascii_only
    assert [word for word in ascii_only.split() if word[0].isdigit()] == [
        word for word in whole.split() if word[0].isdigit()
    ]


def test_deleted_working_folder_is_said(tmp_path):
    done = shell(f'cd {tmp_path}; rmdir {tmp_path}; $PKM')
    assert done.returncode == 1
    assert done.stderr.endswith('pkm: working folder: No such file or directory; change to a folder that exists\n')
    assert 'Traceback' not in done.stderr


@pytest.mark.parametrize('limit', [300, 500, 1499], ids='{} MiB'.format)
def test_address_space_without_room_for_libraries_is_refused(limit):
    """With 500 MiB the library of linear algebra waited without end while it was loaded."""
    done = shell(f'ulimit -v {limit << 10}; $PKM')
    assert done.returncode == 1
    assert done.stderr == f'pkm: address space: limited to {limit} MiB (ulimit -v); expected at least 1500 MiB\n'


def test_another_ros_on_the_import_path_is_left_out(tmp_path):
    """rclpy of the other ROS would raise; a folder of the user's own stays."""
    other, own = tmp_path / 'other', tmp_path / 'own'
    for folder, name in ((other, 'rclpy'), (own, 'mine')):
        (folder / name).mkdir(parents=True)
        (folder / name / '__init__.py').write_text('raise SystemExit("loaded")\n')
    script = (
        'from pkm_core.start import prepare; prepare(); import importlib.util as u, os;'
        'print(u.find_spec("rclpy").origin, u.find_spec("mine").origin, os.environ["PYTHONPATH"])'
    )
    path = os.pathsep.join(map(str, (other, own)))
    done = subprocess.run(
        [sys.executable, '-c', script],
        env=os.environ | {'PYTHONPATH': path},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    rclpy, mine, left = done.stdout.split()
    assert rclpy.startswith(sys.prefix)
    assert mine.startswith(str(own))
    assert left == str(own)
