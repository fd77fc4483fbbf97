"""
Start of a process: signals, standard streams, working folder and import path, before anything else is imported.

Every executable of the project calls `prepare` first. Needs only the standard library.
"""

import codecs
import io
import os
import resource
import sys
import sysconfig
import time
import warnings
from pathlib import Path

from pkm_core.errors import PkmError
from pkm_core.interrupts import end_at_once

# how characters of the tables are written in an encoding that lacks them
_PLAIN = {'±': '+-', '²': '^2', '³': '^3', 'µ': 'u', 'μ': 'u', '×': 'x', '°': 'deg', '…': '...', '–': '-', '→': '->'}

# [bytes] of address space with which a cell of one process runs; with less, libraries hang while they are loaded
_LEAST_SPACE = 1500 << 20


def prepare():
    """
    Prepare the process for everything the user's environment can hold.

    Signals end it at once (`interrupts`), closed standard streams lead to /dev/null, characters that an output
    cannot encode are replaced, and another ROS installation is taken from the import path.

    Raises
    ------
    PkmError
        If the working folder has been deleted, or the address space is limited to less than the libraries need.

    """
    end_at_once()
    # rclpy warns if a signal ends the context while a node is made
    warnings.filterwarnings('ignore', 'Failed to fini', RuntimeWarning)
    _open_standard_streams()
    _leave_other_ros()
    try:
        os.getcwd()
    except OSError as error:
        raise PkmError(f'working folder: {error.strerror}; change to a folder that exists') from None
    space = resource.getrlimit(resource.RLIMIT_AS)[0]
    if 0 <= space < _LEAST_SPACE:
        raise PkmError(
            f'address space: limited to {space >> 20} MiB (ulimit -v); expected at least {_LEAST_SPACE >> 20} MiB'
        )


def seconds_since_start():
    """Return the age of this process [s, wall], with the start of Python and all imports (proc_pid_stat(5))."""
    fields = Path('/proc/self/stat').read_text(encoding='ascii', errors='replace').rpartition(')')[2].split()
    started = int(fields[19]) / os.sysconf('SC_CLK_TCK')  # field 22; the first two are cut off
    return time.clock_gettime(time.CLOCK_BOOTTIME) - started


def _open_standard_streams():
    """Open what is closed, so that no file gets its number, and make every character printable."""
    while True:
        number = os.open(os.devnull, os.O_RDWR)
        if number > 2:
            os.close(number)
            break
    for name, mode in (('stdin', 'r'), ('stdout', 'w'), ('stderr', 'w')):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding='utf-8'))  # noqa: SIM115 (open until the end)
    codecs.register_error('pkm_plain', _replace)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors='pkm_plain')


def _replace(error):
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return ''.join(_PLAIN.get(character, '?') for character in error.object[error.start : error.end]), error.end


def _leave_other_ros():
    """
    Take folders with another rclpy from the import path, of this process and of those it starts.

    Does nothing on a ROS installation without rclpy in its own Python (the image of docker): there PYTHONPATH names
    the only one.
    """
    own = Path(sysconfig.get_path('purelib'))
    if not (own / 'rclpy').is_dir():
        return
    foreign = {path for path in sys.path if path and Path(path) != own and (Path(path) / 'rclpy').is_dir()}
    if not foreign:
        return
    sys.path[:] = [path for path in sys.path if path not in foreign]
    given = os.environ.get('PYTHONPATH', '').split(os.pathsep)
    kept = [path for path in given if path and path not in foreign]
    os.environ['PYTHONPATH'] = os.pathsep.join(kept)
