"""The command `pkm`: prepares the process, then runs the application, whose import takes a tenth of a second."""

import os
import sys

from pkm_core.errors import PkmError
from pkm_core.interrupts import Interrupted
from pkm_core.start import prepare


def main():
    """
    Run the command line and exit.

    A refusal, and an output that cannot be written, give one line on stderr and exit code 1; the reader of a pipe that
    ends first gives 1 without a line. SIGINT and SIGTERM give 130 and 143.
    """
    try:
        prepare()
        try:
            _run()
        finally:
            sys.stdout.flush()
    except PkmError as error:
        _end(1, f'pkm: {error}')
    except Interrupted as interrupted:
        _end(interrupted.code)
    except MemoryError:
        _end(1, 'pkm: out of memory; raise the limit of the address space (ulimit -v), or end other processes')
    except BrokenPipeError:
        _end(1)
    except OSError as error:
        _end(1, f'pkm: {error.filename or "output"}: {error.strerror or error}')


def _run():
    from pkm_core.app import app

    app()


def _end(code, line=''):
    """Exit with `code`; what stdout still holds is dropped, because it may not be writable."""
    if line:
        print(line, file=sys.stderr)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.exit(code)
