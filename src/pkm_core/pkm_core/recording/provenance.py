"""Provenance of a recording: revision of this software, hash of the configuration in use."""

import hashlib
import subprocess
from contextlib import suppress
from functools import cache
from pathlib import Path

from pkm_core.config import find_config, hash_files
from pkm_core.control.controllers import find_control
from pkm_core.errors import ConfigError
from pkm_core.machines import load_machine


@cache
def git_revision():
    """Return the commit of this source tree, '0558f19c1a2b' or, edited, '0558f19c1a2b-dirty'; 'unknown' without git."""
    command = ['git', 'describe', '--always', '--dirty', '--exclude=*', '--abbrev=12']
    folder = Path(__file__).resolve().parent
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=10.0, check=True)
    except (OSError, subprocess.SubprocessError):  # no git, or installed without its repository
        return 'unknown'
    return done.stdout.strip()


def loop_hash(machine, control='robust'):
    """
    Return the hash of the files of `machine`, its model and its gains as they are now on the disk.

    A controller computes it when it starts and with every reload it accepts. The value then describes what it has
    loaded; a later edit of a file changes nothing until the next reload.

    Parameters
    ----------
    machine : str
        Name or file.
    control : str
        Choice of the gains, see `find_control`.

    Returns
    -------
    digits : str
        12 hex digits.

    """
    loaded = load_machine(machine)
    find = loaded.configuration.find
    return hash_files([find('machines', machine), find('model', loaded.name), find_control(loaded, control)[1]])


def config_hash(loops, motion, law):
    """
    Return the hash of the configuration that a cycle rests on.

    Parameters
    ----------
    loops : iterable of str
        `loop_hash` of every controller; equal ones count once. They differ after a reload that only some controllers
        have accepted.
    motion, law : str
        Names or files. Their files are hashed as they are now: the trajectory_generator reads them for every goal. A
        name without a file is left out: law 'none', poses of a goal, experiments of an identification.

    Returns
    -------
    digits : str
        12 hex digits.

    """
    files = []
    for kind, name in (('motions', motion), ('learning', law)):
        with suppress(ConfigError):
            files.append(find_config(kind, name))
    digest = hashlib.sha256(''.join(sorted(set(loops))).encode())
    digest.update(hash_files(files).encode())
    return digest.hexdigest()[:12]
