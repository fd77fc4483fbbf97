"""
Session: the identity of one start of a cell.

Every process of a cell gets the same random id as its parameter `session`. It is in cycle events, goals, results and
bags, so that a client addresses the cell that it has started and no other one. A node without a session ('') accepts
every message: a node started by hand, or a node of another project.
"""

import re
import secrets

from pkm_core.errors import PkmError

SESSION = "id of this start of the cell; events and goals of another session are not accepted, '' accepts all"


def new_session():
    """Return a random id, e.g. 's3f9c01d2'; it begins with a letter, so that YAML does not read it as a number."""
    return f's{secrets.token_hex(4)}'


def checked_session(text):
    """Return `text` if it can be a session; `PkmError` otherwise."""
    if not re.fullmatch(r'[A-Za-z][A-Za-z0-9_]{0,63}|', text, re.ASCII):
        raise PkmError(f'session: {text[:80]!r} given; expected at most 64 letters, digits and _, a letter first')
    return text


def belongs(session, own):
    """Return whether something of `session` is meant for the cell with the session `own`; '' fits every session."""
    return not session or not own or session == own


def require_session(what, session, own):
    """Raise `PkmError` if `what`, a goal or a request, is meant for another session than `own`."""
    if not belongs(session, own):
        raise PkmError(f'{what}: for the cell of session {session!r}; this cell has session {own!r}')
