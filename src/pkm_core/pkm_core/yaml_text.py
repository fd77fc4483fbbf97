"""
YAML read with bounds on size, depth and number of values; in files that people write, no key twice.

PyYAML on its own keeps the last of two equal keys, raises a dozen kinds of error on odd input, and takes minutes for a
file that only grows by its aliases.
"""

from pathlib import Path

import yaml

LONGEST = 200_000  # bytes; the largest file of config has 9 kB
DEEPEST = 20  # levels; the deepest file of config has 6
MOST = 5_000  # values, every use of an alias counted with all it stands for
LONGEST_TEXT = 500  # characters of one value or key
# of a file that a program wrote; metadata.yaml of a bag with 500 topics has 300 kB
LONGEST_WRITTEN = 2_000_000  # bytes
MOST_WRITTEN = 200_000  # values


class YamlError(ValueError):
    """A text that is no YAML of the kind that people write; the message names the line where there is one."""


class _Loader(yaml.SafeLoader):
    """SafeLoader that refuses a doubled key, deep nesting and a flood of aliases."""

    def __init__(self, stream):
        super().__init__(stream)
        self._depth = self._count = 0
        self._sizes = {}

    def compose_node(self, parent, index):
        event, before = self.peek_event(), self._count
        is_alias, self._depth = isinstance(event, yaml.AliasEvent), self._depth + 1
        if self._depth > DEEPEST:
            raise yaml.composer.ComposerError(None, None, f'nested over {DEEPEST} deep', event.start_mark)
        if is_alias and event.anchor in self.anchors and event.anchor not in self._sizes:
            raise yaml.composer.ComposerError(None, None, f'*{event.anchor} stands within itself', event.start_mark)
        node = super().compose_node(parent, index)
        self._count += self._sizes[event.anchor] if is_alias else 1
        if self._count > MOST:
            raise yaml.composer.ComposerError(None, None, f'holds more than {MOST} values', event.start_mark)
        if isinstance(event, yaml.ScalarEvent) and len(event.value) > LONGEST_TEXT:
            text = f'holds a text of {len(event.value)} characters; allowed {LONGEST_TEXT}'
            raise yaml.composer.ComposerError(None, None, text, event.start_mark)
        if event.anchor and not is_alias:
            self._sizes[event.anchor] = self._count - before
        self._depth -= 1
        return node

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key, _ in node.value:
            name = self.construct_object(key, deep=True) if key.tag != 'tag:yaml.org,2002:merge' else '<<'
            try:
                if name in seen:
                    raise yaml.constructor.ConstructorError(None, None, f'key {name!r} stands twice', key.start_mark)
                seen.add(name)
            except TypeError:
                raise yaml.constructor.ConstructorError(
                    None, None, 'a key is a list or a mapping; expected a name', key.start_mark
                ) from None
        return super().construct_mapping(node, deep)


def parse_yaml(text):
    """
    Return what the YAML `text` holds: dicts, lists, texts, numbers, truth values, dates, None.

    Merge keys (``<<: *name``) work. Tags may only be those of YAML itself.

    Raises
    ------
    YamlError
        If the text is no YAML, or exceeds `LONGEST`, `DEEPEST` or `MOST`.

    """
    size = len(text.encode('utf-8', errors='surrogatepass'))
    if size > LONGEST:
        raise YamlError(f'is {size / 1e3:.0f} kB of YAML; allowed {LONGEST / 1e3:g} kB')
    try:
        return yaml.load(text, _Loader)
    except Exception as error:
        raise _refusal(error) from None


def parse_written(text):
    """
    Return what the YAML `text` of a program holds, e.g. metadata.yaml of a bag; 100 times faster than `parse_yaml`.

    Raises
    ------
    YamlError
        If the text is no YAML, has an alias, or exceeds `LONGEST_WRITTEN`, `DEEPEST` or `MOST_WRITTEN`.

    """
    depth = count = 0
    try:
        for event in yaml.parse(text, yaml.CSafeLoader):
            begins = isinstance(event, (yaml.MappingStartEvent, yaml.SequenceStartEvent))
            depth += begins - isinstance(event, (yaml.MappingEndEvent, yaml.SequenceEndEvent))
            count += begins or isinstance(event, yaml.ScalarEvent)
            if depth > DEEPEST or count > MOST_WRITTEN or isinstance(event, yaml.AliasEvent):
                found = 'an alias' if isinstance(event, yaml.AliasEvent) else f'{count} values, {depth} deep'
                raise YamlError(f'holds {found}; allowed {MOST_WRITTEN} values, {DEEPEST} deep, no alias')
        return yaml.load(text, yaml.CSafeLoader)
    except YamlError:
        raise
    except Exception as error:
        raise _refusal(error) from None


def _refusal(error):
    """
    Return an error of PyYAML as a `YamlError`.

    Its constructors raise a dozen kinds for a value whose tag does not fit it, month 99 or a number of 5,000 digits.
    """
    if not isinstance(error, yaml.YAMLError):
        return YamlError(f'holds a value that its YAML type cannot have: {" ".join(str(error)[:200].split())}')
    mark = getattr(error, 'problem_mark', None)
    where = f'line {mark.line + 1}: ' if mark else ''
    return YamlError(f'{where}{" ".join(str(getattr(error, "problem", None) or error).split())}'[:300])


def read_text(path, longest=LONGEST):
    """
    Return the text of a regular file of at most `longest` bytes, UTF-8.

    Raises
    ------
    OSError, UnicodeDecodeError
        If it cannot be read.
    YamlError
        If it is no regular file (a pipe would be waited for), or longer.

    """
    path = Path(path)
    status = path.stat()
    if not path.is_file():
        raise YamlError('is no regular file')
    if status.st_size > longest:
        raise YamlError(f'has {status.st_size / 1e3:.0f} kB; allowed {longest / 1e3:g} kB')
    return path.read_text(encoding='utf-8')
