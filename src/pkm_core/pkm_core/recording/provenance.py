"""Which state of this software is running."""

import subprocess
from contextlib import suppress
from functools import cache
from pathlib import Path

from pkm_core.config import hash_files
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


@cache
def config_hash(machine, motion, law, control='robust'):
    """
    Return the hash of the files that `machine`, `motion`, learning `law` and `control` rest on.

    A motion or law that is none of the configuration is left out: 'none', poses of a goal, experiments.
    """
    loaded = load_machine(machine)
    find = loaded.configuration.find
    files = [find('machines', machine), find('model', loaded.name), find_control(loaded, control)[1]]
    for kind, name in (('motions', motion), ('learning', law)):
        with suppress(ConfigError):
            files.append(find(kind, name))
    return hash_files(files)
