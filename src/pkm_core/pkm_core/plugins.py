"""User-defined classes: named in a configuration file and loaded from a Python file in the same folder."""

import importlib.util
import inspect
from pathlib import Path

from pkm_core.errors import ConfigError


def load_class(named, *, base, beside, key, known, folders=None):
    """
    Return the class named ``<file>.py:<Class>``.

    Parameters
    ----------
    named : str
        Value of the key; other types are refused.
    base : type
        Required base class.
    beside : Path
        The configuration file; the Python file is searched in its folder.
    key : str
        Its key, for the errors.
    known : iterable of str
        The built-in names, for the errors.
    folders : iterable of Path, optional
        Folders that may have the file, by default any.

    Raises
    ------
    ConfigError
        If the name has another form, the file is missing, lies outside `folders` or fails on import, or the class is
        missing, has another base or is abstract.

    """
    where = f'{beside}: {key}'
    file, _, name = named.partition(':') if isinstance(named, str) else ('', '', '')
    if not (file.endswith('.py') and name.isidentifier()):
        raise ConfigError(f"{where}: {named!r} given; expected one of {sorted(known)}, or e.g. 'my_file.py:MyClass'")
    path = (beside.parent / file).resolve()
    if path.parent != beside.parent.resolve():
        raise ConfigError(f'{where}: {file!r} given; expected a file in {beside.parent}')
    if folders is not None and not any(path.is_relative_to(Path(folder).resolve()) for folder in folders):
        allowed = ', '.join(map(str, folders)) or 'none'
        raise ConfigError(
            f'{where}: {path} is not loaded; allowed folders: {allowed}. Start the node with the parameter plugins'
        )
    if not path.is_file():
        raise ConfigError(f'{where}: {path}: no such file')
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None  # a .py file has a spec and a loader
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # the user's file may raise anything
        raise ConfigError(f'{where}: {path} cannot be imported: {type(error).__name__}: {error}') from error
    found = getattr(module, name, None)
    if not (isinstance(found, type) and issubclass(found, base)):
        raise ConfigError(f'{where}: {path} has no class {name} derived from {base.__module__}.{base.__name__}')
    if inspect.isabstract(found):
        lacking = found.__abstractmethods__  # type: ignore[attr-defined]
        raise ConfigError(f'{where}: {name} of {path} does not define {sorted(lacking)}')
    return found
