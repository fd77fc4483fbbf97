"""Classes a configuration file names: built in, or from a Python file of the user's that lies beside it."""

import importlib.util
import inspect

from pkm_core.errors import ConfigError


def load_class(named, *, base, beside, key, known):
    """
    Return the class that ``<file>.py:<Class>`` names.

    Parameters
    ----------
    named : str
        The text of the file; other types are refused.
    base : type
        What the class must be derived from.
    beside : Path
        The configuration file that names it; the Python file is looked for in its folder.
    key : str
        The key it stands under, for the errors.
    known : iterable of str
        The built-in names, for the errors.

    Raises
    ------
    ConfigError
        If it is no such name, the file is missing or fails on import, or has no such class or an unfinished one.

    """
    where = f'{beside}: {key}'
    file, _, name = named.partition(':') if isinstance(named, str) else ('', '', '')
    if not (file.endswith('.py') and name.isidentifier()):
        raise ConfigError(f"{where}: {named!r} given; expected one of {sorted(known)}, or e.g. 'my_file.py:MyClass'")
    path = beside.parent / file
    if not path.is_file():
        raise ConfigError(f'{where}: {path}: no such file')
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None  # a .py file has one, and a loader
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever the user's file raises
        raise ConfigError(f'{where}: {path} cannot be imported: {type(error).__name__}: {error}') from error
    found = getattr(module, name, None)
    if not (isinstance(found, type) and issubclass(found, base)):
        raise ConfigError(f'{where}: {path} has no class {name} derived from {base.__module__}.{base.__name__}')
    if inspect.isabstract(found):
        lacking = found.__abstractmethods__  # type: ignore[attr-defined]
        raise ConfigError(f'{where}: {name} of {path} lacks {sorted(lacking)}')
    return found
