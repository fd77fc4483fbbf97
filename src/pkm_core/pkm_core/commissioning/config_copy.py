"""The configuration of a machine under commissioning: a copy among the results, changed and put back there."""

import os
import shutil
from contextlib import contextmanager
from pathlib import Path

from pkm_core.config import config_folder
from pkm_core.errors import PkmError
from pkm_core.experiments.random_machines import random_machine


class Workplace:
    """
    A configuration folder whose model and gains of one machine may be exchanged.

    Attributes
    ----------
    folder : Path
        What PKM_CONFIG names while the workplace is used, and may name afterwards.
    model, control : Path
        The files of the machine in it.

    """

    def __init__(self, machine, folder):
        self.folder = folder
        self.model, self.control = (folder / kind / f'{machine.name}.yaml' for kind in ('model', 'control'))
        self._as_found = {path: path.read_bytes() for path in (self.model, self.control)}

    def install(self, model, control):
        """Put the files `model` and `control` in the places of the machine's own."""
        for source, target in ((model, self.model), (control, self.control)):
            if source is not None:
                shutil.copyfile(source, target)

    def restore(self):
        """Put back what was found."""
        for path, content in self._as_found.items():
            path.write_bytes(content)


@contextmanager
def workplace(machine, folder, environment, specimen=None):
    """
    Copy the configuration to `folder`/config, let this process and its children use the copy, and yield a `Workplace`.

    With a `specimen`, a whole number, the simulated machine becomes one that nobody knows: another thrust, other modes,
    dampings and friction (`random_machine`), in the copy only.
    """
    copied = Path(folder).resolve() / 'config'
    if copied.exists():
        raise PkmError(f'{copied}: exists; name a folder without the results of another commissioning')
    if specimen is None:
        shutil.copytree(config_folder(), copied)
    else:
        with random_machine(machine, specimen, environment):
            shutil.copytree(config_folder(), copied)
    before = os.environ.get('PKM_CONFIG')
    os.environ['PKM_CONFIG'] = str(copied)
    try:
        yield Workplace(machine, copied)
    finally:
        if before is None:
            del os.environ['PKM_CONFIG']
        else:
            os.environ['PKM_CONFIG'] = before
