"""`ros2 interface show`."""

import re
import sys

from pkm_core.config import install_prefixes
from pkm_nodes.ros2.shared import add_commands

# type, optional size, then the name of a field; a constant has a `=` behind its name
_FIELD = re.compile(r'\s*([A-Za-z]\w*(?:/[A-Za-z]\w*)?)(?:<=\d+)?(?:\[[<=\d]*\])?\s+[A-Za-z]\w*(?!\s*=)')
_PLAIN = {
    *('bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring'),
    *(f'{sign}int{size}' for sign in ('', 'u') for size in (8, 16, 32, 64)),
}


def add_arguments(parser):
    """Add the verbs of `ros2 interface`."""
    verb = add_commands(parser, {'show': 'Output the interface definition'})['show']
    verb.set_defaults(main=show)
    comments = verb.add_mutually_exclusive_group()
    comments.add_argument(
        '--all-comments',
        action='store_true',
        help='Show all comments, including for nested interface definitions',
    )
    comments.add_argument('--no-comments', action='store_true', help='Show no comments or whitespace')
    verb.add_argument(
        'type',
        help="Show an interface definition (e.g. 'example_interfaces/msg/String'). Passing '-' reads the argument "
        "from stdin (e.g. 'ros2 topic type /chatter | ros2 interface show -').",
    )


def show(args):
    """Print the definition of a message, service or action, and indented those of the messages in it."""
    name = sys.stdin.readline().strip() if args.type == '-' else args.type
    if not name:
        return 'the passed value is empty'
    print('\n'.join(definition(name, not args.no_comments, args.all_comments)))
    return None


def definition(name, with_comments=True, with_nested_comments=False, indent=''):
    """Return the lines of the definition of the interface `name`, 'package/kind/Name'."""
    lines = []
    for line in map(str.rstrip, text_of(name).splitlines()):
        if with_comments or _code(line):
            shown = line if with_comments or line == '---' else _code(line)
            lines.append(f'{indent}{shown}' if shown else '')
        nested = _nested(line, name.partition('/')[0])
        if nested:
            lines += definition(nested, with_nested_comments, with_nested_comments, f'{indent}\t')
    return lines


def _code(line):
    """Return a line without its comment; a `#` within quotes is none."""
    return re.match(r'((?:"[^"]*"|\'[^\']*\'|[^#"\'])*)', line)[1].strip()


def _nested(line, package):
    """Return the message type of the field that `line` defines, '' if it defines none or one of a plain type."""
    found = _FIELD.match(_code(line))
    if not found or found[1] in _PLAIN:
        return ''
    return f'{package}/msg/{found[1]}' if '/' not in found[1] else found[1].replace('/', '/msg/')


def text_of(name):
    """Return the file with the definition of the interface `name`."""
    parts = name.split('/')
    if len(parts) != 3:
        raise RuntimeError(f"Invalid name '{name}'. Expected three parts separated by '/'")
    package, kind, short = parts
    for prefix in install_prefixes():
        path = prefix / 'share' / package / kind / f'{short}.{kind}'
        if path.is_file():
            return path.read_text(encoding='utf-8')
    raise RuntimeError(f"Could not find the interface '{name}'")
