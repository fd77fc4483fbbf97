"""
SIGINT and SIGTERM: at any moment a process ends in order, with exit code 130 or 143, and without a traceback.

Outside of `interruptible` nothing needs an orderly end: the process ends at once. Within it the signal raises
`Interrupted`, so that context managers stop what they have started. `held_back` delays that to the end of its block.

The start scripts of this project are started with both signals blocked, so that Python itself, which takes a tenth of
a second to start, is not interrupted; `end_at_once` unblocks them. Needs only the standard library: imported first.
"""

import os
import signal
import sys
from contextlib import contextmanager, suppress

SIGNALS = (signal.SIGINT, signal.SIGTERM)
_state = {'held': 0, 'pending': 0}


class Interrupted(BaseException):
    """
    The process was interrupted; not an `Exception`, so that no handler of errors takes it.

    Parameters
    ----------
    number : int
        Of the signal.

    """

    def __init__(self, number):
        super().__init__(signal.Signals(number).name)
        self.code = exit_code(number)


def exit_code(number):
    """Return the exit code of a process that the signal `number` has ended: 130 or 143, as shells report it."""
    return 128 + number


def end_at_once():
    """Let both signals end this process at once, from now on, and unblock them."""
    for number in SIGNALS:
        signal.signal(number, _end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def _end(number, _):
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):  # closed, full, or interrupted while it was written
            stream.flush()
    os._exit(exit_code(number))


@contextmanager
def interruptible():
    """Raise `Interrupted` in the block when a signal arrives; in the main thread only, elsewhere it does nothing."""
    try:
        before = [signal.signal(number, _raise) for number in SIGNALS]
    except ValueError:  # not the main thread
        yield
        return
    try:
        yield
    finally:
        for number, handler in zip(SIGNALS, before, strict=True):
            signal.signal(number, handler)


@contextmanager
def held_back():
    """Delay `Interrupted` to the end of the block: what is in it is done completely."""
    _state['held'] += 1
    try:
        yield
    finally:
        _state['held'] -= 1
    if _state['pending'] and not _state['held']:
        number, _state['pending'] = _state['pending'], 0
        raise Interrupted(number)


def _raise(number, _):
    if _state['held']:
        _state['pending'] = number
    else:
        raise Interrupted(number)


@contextmanager
def blocked(numbers=SIGNALS):
    """Block signals in the block; a process that is started in it starts with them blocked."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
