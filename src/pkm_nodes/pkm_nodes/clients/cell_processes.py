"""The processes of a cell: start from the list of graph.py, supervision, and stop by process id."""

import ctypes
import os
import signal
import subprocess
from contextlib import ExitStack
from pathlib import Path
from time import monotonic, sleep

from pkm_core.config import install_prefixes
from pkm_core.errors import PkmError
from pkm_core.interrupts import held_back, interruptible
from pkm_nodes.clients.shared_memory import remove_leftovers
from pkm_nodes.graph import NAMESPACE, cell_nodes, composed_cell, leave_out
from pkm_nodes.parts.cell_lock import require_free
from pkm_nodes.runtime.session import new_session

# [s, wall] from SIGINT to SIGKILL
_PATIENCE = 10.0
# [s, wall] for which a process may be stopped, and between two looks at that
_STOPPED, _LOOK_EVERY = 8.0, 0.5


def _end_with(parent):
    """Return a function that makes Linux interrupt the process that calls it when `parent` ends, however it ends."""
    libc, set_parent_death_signal = ctypes.CDLL(None), 1  # PR_SET_PDEATHSIG of sys/prctl.h

    def end_with_parent():
        libc.prctl(set_parent_death_signal, signal.SIGINT)
        if os.getppid() != parent:  # it ended before
            os._exit(1)

    return end_with_parent


def _executables():
    """Return the folder of this package's executables, in which `ros2 run` finds them."""
    folders = [prefix / 'lib' / 'pkm_nodes' for prefix in install_prefixes()]
    for folder in folders:
        if folder.is_dir():
            return folder
    raise PkmError(f'pkm_nodes: not installed; searched {[str(folder) for folder in folders]}')


class CellProcesses:
    """
    A cell in processes of its own; use it in a ``with`` block.

    Parameters
    ----------
    machine : str
        Machine of config/machines or a file.
    arrangement : str
        'composed': one process; 'processes': one process per node.
    namespace : str
        ROS namespace of the cell.
    control : str
        Choice of the controllers, see `controllers.find_control`.
    seed, environment
        Of the simulated machine.
    folder : Path
        Gets the bags in ``bags/`` and the output of the processes in ``log/``.
    record : bool
        Whether there is a recorder.
    without : sequence of str
        Names of nodes to leave out.
    plugins, learned, learning_target, pace : str, str, str, float
        See `cell_nodes`.
    configuration : Configuration, optional
        What the nodes work with, by default that of the environment.

    Attributes
    ----------
    session : str
        Id of this start of the cell.
    bags : Path
        Folder of the recorder.
    seed, environment : int, str
        As given.
    nodes, left_out : list of NodeSpec
        Nodes that this cell runs, and nodes that it does not.

    """

    def __init__(
        self,
        machine,
        arrangement,
        *,
        namespace=NAMESPACE,
        control='robust',
        seed,
        environment,
        folder,
        record=True,
        without=(),
        plugins='',
        learned='',
        learning_target='joints',
        pace=0.0,
        configuration=None,
    ):
        named = {'PKM_CONFIG': str(configuration.folder)} if configuration else {}
        self._environment = os.environ | named
        self.bags, self._logs = Path(folder) / 'bags', Path(folder) / 'log'
        self.seed, self.environment = seed, environment
        self._namespace, self.session = namespace, new_session()
        self._logs.mkdir(parents=True, exist_ok=True)
        options = {
            'control': control,
            'seed': seed,
            'environment': environment,
            'folder': str(self.bags),
            'record': record,
        }
        options |= {'plugins': plugins, 'learned': str(learned), 'learning_target': learning_target, 'pace': pace}
        nodes = cell_nodes(machine, **options)
        self.nodes = leave_out(nodes, without)
        self.left_out = [spec for spec in nodes if spec not in self.nodes]
        specs = [composed_cell(machine, **options, without=without)] if arrangement == 'composed' else self.nodes
        self._specs = {spec.name: spec for spec in specs}
        self.processes = {}
        self._stopped, self._look_at = {}, 0.0  # since when [s, wall] by name, and the time of the next look

    def __enter__(self):
        remove_leftovers()
        require_free(self._namespace)  # the machine itself refuses too, but only once its process is up
        with ExitStack() as stack:
            stack.enter_context(interruptible())
            stack.callback(self._stop)
            with held_back():
                for name in self._specs:
                    self.start(name)
            self._stack = stack.pop_all()
        return self

    def command(self, executable):
        """Return the command that starts an executable of pkm_nodes."""
        return [str(_executables() / executable)]

    def arguments(self, spec):
        """Return the arguments that make it the node `spec` of this cell."""
        return spec.arguments({'use_sim_time': True, 'session': self.session}, self._namespace)

    def start(self, name):
        """Start the process `name`; it can be started again after it has ended."""
        spec = self._specs[name]
        with (self._logs / f'{name}.log').open('a') as log:
            self.processes[name] = subprocess.Popen(
                [*self.command(spec.executable), *self.arguments(spec)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                env=self._environment,
                stderr=subprocess.STDOUT,
                # a Ctrl-C in the terminal goes to the parent only, which then stops the cell in order
                start_new_session=True,
                preexec_fn=_end_with(os.getpid()),  # noqa: PLW1509 (it takes no lock)
            )

    def __exit__(self, *_):
        self._stack.close()

    def _stop(self):
        with held_back():
            self._end_all()

    def _end_all(self):
        for process in self.processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                process.send_signal(signal.SIGCONT)  # a stopped process takes the other signal only when it continues
        deadline = monotonic() + _PATIENCE
        for process in self.processes.values():
            while process.poll() is None and monotonic() < deadline:
                sleep(0.02)
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()

    def check(self):
        """Raise `PkmError` if a process has ended, with the last lines of its output, or is stopped for long."""
        self._refuse_stopped()
        for name, process in self.processes.items():
            code = process.poll()
            if code is not None:
                log = self._logs / f'{name}.log'
                tail = '\n'.join(log.read_text(errors='replace').splitlines()[-5:])
                raise PkmError(f'{name} has ended with code {code}; {log} ends:\n{tail}')

    def _refuse_stopped(self):
        """Raise `PkmError` if a process has been stopped (SIGSTOP) for `_STOPPED`; looks every `_LOOK_EVERY`."""
        now = monotonic()
        if now < self._look_at:
            return
        self._look_at = now + _LOOK_EVERY
        stopped = [name for name, process in self.processes.items() if _state_of(process.pid) in 'Tt']
        self._stopped = {name: self._stopped.get(name, now) for name in stopped}
        for name, since in self._stopped.items():
            if now - since >= _STOPPED:
                raise PkmError(
                    f'{name} (process {self.processes[name].pid}) is stopped, by SIGSTOP or a debugger, for '
                    f'{now - since:.0f} s; continue it (SIGCONT) and run again'
                )


def _state_of(pid):
    """Return the letter of the state of a process in /proc, 'T' for stopped; '-' if that is unknown."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(') ')[2][:1] or '-'
    except OSError:
        return '-'
