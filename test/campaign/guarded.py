"""Runs a function on a doubtful file in a process of its own, with limits on memory and time."""

import os
import pickle
import resource
import signal
import traceback
from pathlib import Path

from pkm_core.errors import PkmError

SECONDS = 20  # of CPU time, so that other load of the computer does not count
WAITING = 200  # [s, wall]
MEMORY = 2 << 30  # [B] beyond what the process has at its start
LONGEST_REFUSAL = 400  # characters, without the folder of the file


def _child(function, pipe, folder):
    """Run `function` and write its outcome to `pipe`; never returns."""
    code = 0
    try:
        pages = int(Path('/proc/self/statm').read_text().split()[0])
        limit = pages * resource.getpagesize() + MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        signal.alarm(WAITING)
        try:
            function()
            outcome = ''
        except PkmError as refusal:
            text = str(refusal).replace(str(folder), '')
            outcome = f'refusal of {len(text)} characters' if len(text) > LONGEST_REFUSAL else ''
        except BaseException as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            where = f'{os.path.basename(last.filename)}:{last.lineno}'
            outcome = f'{type(error).__name__} at {where}: {str(error)[:120]}'
        os.write(pipe, pickle.dumps(outcome))
    except BaseException:
        code = 1
    os._exit(code)


def outcome_of(function, folder=''):
    """
    Return '' if `function()` returns or refuses a file in `folder` in one short `PkmError`, else what happened.

    The process ends with an exception of another kind, by a signal, or at a limit of time or memory.
    """
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(read)
        _child(function, write, folder)
    os.close(write)
    with os.fdopen(read, 'rb') as stream:
        data = stream.read()
    _, status = os.waitpid(pid, 0)
    if os.WIFSIGNALED(status):
        sent = os.WTERMSIG(status)
        late = {signal.SIGPROF: f'no end within {SECONDS} s of CPU time', signal.SIGALRM: f'no end within {WAITING} s'}
        return late.get(sent, f'ended by signal {sent}')
    return pickle.loads(data) if data else 'ended without an outcome'
