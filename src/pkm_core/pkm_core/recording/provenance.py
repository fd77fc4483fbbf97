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
    try:
        commit = _git('rev-parse', '--short=12', 'HEAD')
        return f'{commit}-dirty' if _git('status', '--porcelain', '--untracked-files=no') else commit
    except (OSError, subprocess.SubprocessError):  # no git, or installed without its repository
        return 'unknown'


def _git(*words):
    """Return what git prints. It takes no lock: on a full disk that would stay and stop the user's next commit."""
    command = ['git', '--no-optional-locks', *words]
    folder = Path(__file__).resolve().parent
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=10.0, check=True)
    return done.stdout.strip()


def machine_hash(name, configuration=None):
    """Return the hash of the file of the machine `name`, 12 hex digits; computed when a node loads the machine."""
    return hash_files([find_config('machines', name, configuration)])


def loop_hash(machine, control, of_machine):
    """
    Return the hash of what a control loop is made of: the machine, and the files of model and gains as they are now.

    A controller computes it when it starts and with every reload it accepts. The value then describes what it has
    loaded: a later edit of a file changes nothing until the next reload. The machine's file is loaded at the start and
    by `geometry/load` only.

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
    return joined_hash(of_machine, control_hash(machine, control))


def control_hash(machine, control):
    """Return the hash of the files of model and gains as they are now; arguments of `loop_hash`."""
    return hash_files([find_config('model', machine.name, machine.configuration), find_control(machine, control)[1]])


def truth_hash(machine):
    """Return the hash of the file from which the simulated `machine` is made, 12 hex digits; it is not interpreted."""
    return hash_files([machine.configuration.find('truth', machine.name)])


def config_hash(loops, motion, law, configuration=None, tool_law=''):
    """
    Return the hash of the configuration that a cycle rests on.

    Parameters
    ----------
    loops : iterable of str
        `loop_hash` of every controller, `truth_hash` of a simulated machine; equal ones count once. Those of
        controllers differ after a reload that only some have accepted.
    motion, law : str
        Names or files. Their files are hashed as they are now: the trajectory_generator reads them for every goal. A
        name without a file is left out: law 'none', poses of a goal, experiments of an identification.
    configuration : Configuration, optional
        Where names are found; the environment's by default.
    tool_law : str, optional
        Name or file of the law by which the reference is learned; '' without one. Hashed as it is now.

    Returns
    -------
    digits : str
        12 hex digits.

    """
    files = []
    for kind, name in (('motions', motion), ('learning', law), ('learning/tool', tool_law)):
        if not name:
            continue
        with suppress(ConfigError):
            files.append(find_config(kind, name, configuration))
    return joined_hash(*sorted(set(loops)), hash_files(files))


def joined_hash(*digests):
    """Return the hash of `digests`, which counts their order."""
    return hashlib.sha256(' '.join(digests).encode()).hexdigest()[:12]
