"""Machines whose truth differs from config/truth; models, gains and laws of the controllers do not change."""

import shutil
import tempfile
from contextlib import contextmanager
from pathlib import Path

import yaml

from pkm_core.config import Configuration, load_config, read_yaml
from pkm_core.errors import ConfigError
from pkm_core.plant.truth import Truth


@contextmanager
def changed_machine(machine, environment, change):
    """
    Yield `machine` with a copy of its configuration in which ``change(truth)`` has edited the truth file.

    The copy is deleted when the block ends. Errors and further arguments as for `change_truth`.
    """
    with tempfile.TemporaryDirectory() as folder:
        copied = Configuration(Path(folder) / 'config')
        shutil.copytree(machine.configuration.folder, copied.folder)
        change_truth(copied, machine.name, environment, change)
        yield machine.with_configuration(copied)


def change_truth(configuration, name, environment, change):
    """
    Edit the truth file of the machine `name` in `configuration`.

    ``change(truth)`` receives the file's mapping, with quantities as text, and modifies it.

    Raises
    ------
    ConfigError
        If the file is refused or has no such `environment`.

    """
    path = configuration.find('truth', name)
    load_config(path, Truth)
    truth = read_yaml(path)
    if environment not in truth['environments']:
        raise ConfigError(f'{path}: environment {environment!r} is unknown; known: {sorted(truth["environments"])}')
    change(truth)
    path.write_text(yaml.safe_dump(truth, sort_keys=False), encoding='utf-8')
