"""Copy of the configuration of a machine under commissioning, in the folder of results."""

import shutil
from pathlib import Path

from pkm_core.config import Configuration
from pkm_core.errors import PkmError
from pkm_core.plant.random_truth import draw_truth


class ConfigCopy:
    """
    A copy of the configuration in which model, gains and lengths of one machine can be replaced.

    Attributes
    ----------
    configuration : Configuration
        The copy.
    machine : Machine
        The machine with this configuration.
    model_file, gains_file : Path
        The files of models and gains of the machine in the copy.

    """

    def __init__(self, machine, configuration):
        self.configuration = configuration
        self.machine = machine.with_configuration(configuration)
        self.model_file, self.gains_file = (
            configuration.folder / kind / f'{machine.name}.yaml' for kind in ('model', 'control')
        )
        self._as_found = {path: path.read_bytes() for path in (self.model_file, self.gains_file)}

    def install(self, model_file, gains_file):
        """Copy `model_file` and `gains_file` over the machine's own files; None keeps a file unchanged."""
        for source, target in ((model_file, self.model_file), (gains_file, self.gains_file)):
            if source is not None:
                shutil.copyfile(source, target)

    def install_machine(self, machine_file):
        """Copy the calibrated `machine_file` over the file of the machine."""
        shutil.copyfile(machine_file, self.configuration.folder / 'machines' / f'{self.machine.name}.yaml')

    def restore(self):
        """Restore models and gains to their state at construction."""
        for path, content in self._as_found.items():
            path.write_bytes(content)


def copy_config(machine, folder, environment, truth_seed=None):
    """
    Copy the configuration of `machine` to `folder`/config and return the `ConfigCopy`.

    With a `truth_seed`, a whole number, thrust, modes, dampings and friction of the simulated machine become random
    (`random_machine`), in the copy only.

    Raises
    ------
    PkmError
        If `folder`/config exists.

    """
    copied = Configuration(Path(folder).resolve() / 'config')
    if copied.folder.exists():
        raise PkmError(f'{copied.folder}: exists; name a folder without the results of another commissioning')
    shutil.copytree(machine.configuration.folder, copied.folder)
    if truth_seed is not None:
        draw_truth(copied, machine.name, truth_seed, environment)
    return ConfigCopy(machine, copied)
