"""One machine per namespace: the second one is refused, with the process that holds the namespace."""

import fcntl
import json
import os
import re
import socket
import tempfile
from pathlib import Path
from time import monotonic, sleep

from pkm_core.errors import PkmError

# [s] a client that only looks whether the namespace is free holds the lock for microseconds
_PATIENCE = 0.3


def _folder():
    """Return the folder of the locks of this user, which no other user can write."""
    runtime = Path(os.environ.get('XDG_RUNTIME_DIR') or '/nonexistent')
    folder = (runtime if runtime.is_dir() else Path(tempfile.gettempdir())) / f'pkm-{os.getuid()}'
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise PkmError(f'{folder}: cannot be made: {error.strerror}; expected a writable temporary folder') from None
    if folder.is_symlink() or folder.stat().st_uid != os.getuid():
        raise PkmError(f'{folder}: belongs to another user; expected a folder of user {os.getuid()}')
    return folder


def _file(namespace):
    """Return the lock file of `namespace` in this ROS domain and network."""
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    network = os.stat('/proc/self/ns/net').st_ino  # containers and network namespaces do not reach each other
    name = re.sub(r'\W+', '_', f'{domain}_{namespace}', flags=re.ASCII)
    return _folder() / f'cell_{name}_{network}.lock'


class CellLock:
    """
    Marks `namespace` as the place of one cell until `release`; the mark ends with the process, however that ends.

    Parameters
    ----------
    namespace : str
        ROS namespace of the cell.
    node, session : str
        Of the machine, for the refusal of a second one.

    Raises
    ------
    PkmError
        If a machine of this user runs in the namespace: its node, host, process id, domain and session are named.

    """

    def __init__(self, namespace, node, session):
        self._descriptor = _locked(namespace)
        domain = os.environ.get('ROS_DOMAIN_ID') or '0'
        facts = {'node': node, 'host': socket.gethostname(), 'pid': os.getpid(), 'domain': domain, 'session': session}
        os.ftruncate(self._descriptor, 0)
        os.pwrite(self._descriptor, json.dumps(facts).encode(), 0)

    def release(self):
        """Let another machine have the namespace."""
        os.close(self._descriptor)


def require_free(namespace):
    """Raise the `PkmError` of `CellLock` if a machine of this user runs in `namespace`."""
    os.close(_locked(namespace))


def _locked(namespace):
    """Return the descriptor of the lock file of `namespace`, locked; `PkmError` if it stays locked for `_PATIENCE`."""
    descriptor = os.open(_file(namespace), os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    deadline = monotonic() + _PATIENCE
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return descriptor
        except OSError:
            if monotonic() < deadline:
                sleep(0.02)
                continue
            holder = _read(descriptor)
            os.close(descriptor)
            raise PkmError(_refusal(namespace, holder)) from None


def _read(descriptor):
    try:
        return json.loads(os.pread(descriptor, 4096, 0))
    except ValueError:  # the other process has taken the lock and not yet written
        return {}


def _refusal(namespace, holder):
    names = [name for name in ('node', 'host', 'pid', 'domain', 'session') if name in holder]
    facts = ', '.join(f'{name} {holder[name]}' for name in names) or 'it is starting'
    return f'a cell runs in {namespace}: {facts}; stop it, or choose another --namespace or ROS_DOMAIN_ID'
