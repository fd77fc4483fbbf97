"""YAML with bounds: odd input is refused by where and what, quickly, and never read as something else."""

import os
from contextlib import suppress

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pkm_core.config import Config, ConfigError, load_config
from pkm_core.yaml_text import LONGEST, YamlError, parse_yaml

BOMB = 'a: &a [x, x, x, x, x, x, x, x, x]\n' + ''.join(
    f'{name}: &{name} [{", ".join([f"*{before}"] * 9)}]\n' for before, name in zip('abcdefgh', 'bcdefghi', strict=True)
)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('a: 1\na: 2', "line 2: key 'a' stands twice"),
        ('a: !!int x', 'value that its YAML type cannot have: invalid literal'),
        ('a: 2020-99-01', 'month must be in 1..12'),
        ('a: ' + '9' * 5000, 'line 1: holds a text of 5000 characters; allowed 500'),
        ('[' * 500, 'nested over 20 deep'),
        ('a: &x [*x]', r'line 1: \*x stands within itself'),
        (BOMB, 'holds more than 5000 values'),
        (''.join(f'k{number}: 1\n' for number in range(8000)), 'holds more than 5000 values'),
        ('x' * (LONGEST + 1), 'is 200 kB of YAML; allowed 200 kB'),
        ('a: !!python/object/apply:os.system [x]', 'could not determine a constructor for the tag'),
        ('? [a]\n: 1', 'a key is a list or a mapping'),
        ('a: !!timestamp 3', 'value that its YAML type cannot have'),
        ('\t- a', 'cannot start any token'),
    ],
)
def test_odd_yaml_is_refused_by_what_is_wrong(text, reason):
    with pytest.raises(YamlError, match=reason):
        parse_yaml(text)


def test_merge_key_takes_over_what_is_not_given():
    text = 'base: &base {x: 1, y: 2}\nown:\n  <<: *base\n  y: 3\n'
    assert parse_yaml(text)['own'] == {'x': 1, 'y': 3}


LEAVES = st.none() | st.booleans() | st.integers() | st.text(max_size=20)


def branches(leaves):
    return st.lists(leaves, max_size=4) | st.dictionaries(st.text(max_size=8), leaves, max_size=4)


@given(st.recursive(LEAVES, branches))
def test_ordinary_yaml_is_read_as_it_was_written(data):
    assert parse_yaml(yaml.safe_dump(data)) == data


@given(st.text(max_size=200))
def test_any_text_is_read_or_refused(text):
    with suppress(YamlError):
        parse_yaml(text)


class _File(Config):
    """A file with one key."""

    number: int


def test_refusal_of_a_huge_value_is_short(tmp_path):
    path = tmp_path / 'odd.yaml'
    path.write_text(f'number: {["long"] * 900}\n')
    with pytest.raises(ConfigError) as refusal:
        load_config(path, _File)
    assert len(str(refusal.value)) < 300


def test_refusal_of_many_keys_names_the_first_ones(tmp_path):
    path = tmp_path / 'odd.yaml'
    path.write_text('number: 1\n' + ''.join(f'k{number}: 1\n' for number in range(300)))
    with pytest.raises(ConfigError, match='and 295 more') as refusal:
        load_config(path, _File)
    assert len(str(refusal.value)) < 1000


def test_pipe_in_place_of_a_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / 'pipe.yaml')
    with pytest.raises(ConfigError, match='is no regular file'):
        load_config(tmp_path / 'pipe.yaml', _File)
