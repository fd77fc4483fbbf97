"""The configuration of a machine under commissioning: a copy among the results, changed and restored there."""

import shutil
from pathlib import Path

from pkm_core.config import Configuration
from pkm_core.errors import PkmError
from pkm_core.plant.random_truth import draw_truth


class ConfigCopy:
    """
    A copy of the configuration in which model and gains of one machine can be exchanged.

    Attributes
    ----------
    configuration : Configuration
        The copy.
    machine : Machine
        The machine with this configuration.
    model, control : Path
        The files of the machine in it.

    """

    def __init__(self, machine, configuration):
        self.configuration = configuration
        self.machine = machine.with_configuration(configuration)
        self.model, self.control = (
            configuration.folder / kind / f'{machine.name}.yaml' for kind in ('model', 'control')
        )
        self._as_found = {path: path.read_bytes() for path in (self.model, self.control)}

    def install(self, model, control):
        """Replace the machine's own files by the files `model` and `control`; None leaves a file as it is."""
        for source, target in ((model, self.model), (control, self.control)):
            if source is not None:
                shutil.copyfile(source, target)

    def restore(self):
        """Write back the model and the gains that were copied."""
        for path, content in self._as_found.items():
            path.write_bytes(content)


def copy_config(machine, folder, environment, specimen=None):
    """
    Copy the configuration of `machine` to `folder`/config and return the `ConfigCopy`.

    With a `specimen`, a whole number, the simulated machine becomes an unknown one: another thrust, other modes,
    dampings and friction (`random_machine`), in the copy only.

    Raises
    ------
    PkmError
        If `folder`/config exists.

    """
    copied = Configuration(Path(folder).resolve() / 'config')
    if copied.folder.exists():
        raise PkmError(f'{copied.folder}: exists; name a folder without the results of another commissioning')
    shutil.copytree(machine.configuration.folder, copied.folder)
    if specimen is not None:
        draw_truth(copied, machine.name, specimen, environment)
    return ConfigCopy(machine, copied)
