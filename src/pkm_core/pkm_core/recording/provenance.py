"""Provenance of a recording: revision of this software, hash of the configuration in use."""

import hashlib
import subprocess
from contextlib import suppress
from functools import cache
from pathlib import Path

from pkm_core.config import find_config, hash_files
from pkm_core.control.controllers import find_control
from pkm_core.errors import ConfigError


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


def machine_hash(name, configuration=None):
    """Return the hash of the file of the machine `name`, 12 hex digits; computed when a node loads the machine."""
    return hash_files([find_config('machines', name, configuration)])


def loop_hash(machine, control, of_machine):
    """
    Return the hash of what a control loop is made of: the machine, and the files of model and gains as they are now.

    A controller computes it when it starts and with every reload it accepts. The value then describes what it has
    loaded: a later edit of a file changes nothing until the next reload, and an edit of the machine's file nothing at
    all, because a reload does not load the machine.

    Parameters
    ----------
    machine : Machine
        With the configuration of its model and gains.
    control : str
        Choice of the gains, see `find_control`.
    of_machine : str
        `machine_hash` when the machine was loaded.

    Returns
    -------
    digits : str
        12 hex digits.

    """
    files = hash_files([find_config('model', machine.name, machine.configuration), find_control(machine, control)[1]])
    return _combined(of_machine, files)


def config_hash(loops, motion, law, configuration=None):
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
    configuration : Configuration, optional
        Where names are found; the environment's by default.

    Returns
    -------
    digits : str
        12 hex digits.

    """
    files = []
    for kind, name in (('motions', motion), ('learning', law)):
        with suppress(ConfigError):
            files.append(find_config(kind, name, configuration))
    return _combined(*sorted(set(loops)), hash_files(files))


def _combined(*digests):
    return hashlib.sha256(' '.join(digests).encode()).hexdigest()[:12]
