"""Places on the command line of this process that give a parameter to a node: for refusals that name them."""

import sys
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

from pkm_core.yaml_text import LONGEST_WRITTEN, YamlError, parse_written, read_text

_VALUES = 'ros__parameters'
_OF_LAUNCH = 'launch_params_'  # launch writes the parameters of one node into such a file, for all nodes of the process


class Source(NamedTuple):
    """One place."""

    text: str  # for a message
    for_all: bool  # a section of a file for any node, which may hold parameters of others


def sources_of(name, node):
    """Return the `Source`s of the parameter `name` of the node with the full name `node`, e.g. '/pkm/machine'."""
    found = []
    for option, value in zip(sys.argv, sys.argv[1:], strict=False):
        if option in ('-p', '--param') and value.split(':=')[0].rpartition(':')[2] == name:
            found.append(Source(f'{option} {value}', for_all=False))
        elif option == '--params-file':
            found += [
                Source(f'{value}, section {section}', '*' in section and not Path(value).name.startswith(_OF_LAUNCH))
                for section, names in _sections(value)
                if name in names and _concerns(section, node)
            ]
    return found


def place_of(name, node):
    """Return ' (PLACE)' for a message about the parameter `name` of `node`, '' if it is not of the command line."""
    found = sources_of(name, node)
    return f' ({found[-1].text})' if found else ''


def _sections(file):
    """Return [(name of the node or pattern, names of its parameters)] of a parameter file; [] if it cannot be read."""
    try:
        content = parse_written(read_text(file, LONGEST_WRITTEN))
    except (OSError, UnicodeDecodeError, YamlError):  # ROS has read or refused it
        return []
    return list(_below('', content))


def _below(path, content):
    if isinstance(content, dict):
        for key, value in content.items():
            if key == _VALUES:
                yield path, set(_names('', value))
            else:
                yield from _below(f'{path.rstrip("/")}/{str(key).lstrip("/")}', value)


def _names(prefix, values):
    if isinstance(values, dict):
        for key, value in values.items():
            yield f'{prefix}{key}'
            yield from _names(f'{prefix}{key}.', value)


def _concerns(section, node):
    """Return whether a section is for `node`: `*` stands for one name, `**` for any number; a bare name counts too."""
    return fnmatchcase(node, section.replace('**', '*')) or section == f'/{node.rpartition("/")[2]}'
