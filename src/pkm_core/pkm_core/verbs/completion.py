"""Completion of option values: the names in the configuration in use. Files complete as in any shell."""

import yaml

from pkm_core.config import Configuration
from pkm_core.errors import ConfigError


def names_of(*kinds, more=()):
    """
    Return the completion of an option whose values are the names of files of the configuration.

    Parameters
    ----------
    *kinds : str
        Folders of the configuration, such as 'machines'.
    more : tuple of str
        Further values.

    Returns
    -------
    complete : callable
        ``complete(incomplete)`` returns the names that begin with the text typed so far; a callback for typer.

    """

    def complete(incomplete: str):
        return _beginning(incomplete, [*more, *(name for kind in kinds for name in _configured(kind))])

    return complete


def machines_with_models(incomplete: str):
    """Return the names of the machines that have a model for controllers: those without dynamics have none."""
    return _beginning(incomplete, set(_configured('machines')) & set(_configured('model')))


def _configured(kind):
    """Return the names of `kind`; none without a configuration, which a verb reports when it runs."""
    try:
        return Configuration.of_environment().names(kind)
    except ConfigError:
        return []


def _beginning(incomplete, names):
    return sorted({name for name in names if name.startswith(incomplete)})


def environments(incomplete: str):
    """Return the names of the environments of all simulated machines, from the keys of config/truth."""
    try:
        folder = Configuration.of_environment().folder / 'truth'
        sections = [yaml.safe_load(path.read_text(encoding='utf-8'))['environments'] for path in folder.glob('*.yaml')]
    except (ConfigError, OSError, yaml.YAMLError, KeyError, TypeError):
        return []
    return _beginning(incomplete, [name for names in sections for name in names])
