"""The gates of .pre-commit-config.yaml and of bringup_scripts/test are the same commands."""

import re
import shlex
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
CORE_TESTS = 'test/core'


@pytest.fixture
def hooks():
    """Return the hooks of every repository in the configuration."""
    configuration = yaml.safe_load((ROOT / '.pre-commit-config.yaml').read_text(encoding='utf-8'))
    return [hook for repository in configuration['repos'] for hook in repository['hooks']]


def gates():
    """Return the commands of bringup_scripts/test, as words, with the core tests in place of its arguments."""
    text = (ROOT / 'bringup_scripts' / 'test').read_text(encoding='utf-8')
    commands = re.findall(r'^(?:exec )?(\.venv/bin/.*)$', text, re.MULTILINE)
    return [shlex.split(command.replace('"$@"', CORE_TESTS)) for command in commands]


def test_hooks_run_the_commands_of_the_test_script(hooks):
    """Same tools, options and order; the tests are restricted to test/core."""
    assert len(gates()) == 4
    assert [shlex.split(hook['entry']) for hook in hooks] == gates()


def test_hooks_check_the_whole_tree(hooks):
    """A hook that receives the changed files alone would pass what bringup_scripts/test refuses."""
    for hook in hooks:
        assert (hook['language'], hook['pass_filenames'], hook['always_run']) == ('system', False, True), hook['id']


def test_hooks_need_no_remote_repository():
    """Every tool comes from .venv in its locked version."""
    configuration = yaml.safe_load((ROOT / '.pre-commit-config.yaml').read_text(encoding='utf-8'))
    assert {repository['repo'] for repository in configuration['repos']} == {'local'}


def test_every_stage_of_a_hook_is_installed(hooks):
    """`pre-commit install` installs the stages of default_install_hook_types only."""
    configuration = yaml.safe_load((ROOT / '.pre-commit-config.yaml').read_text(encoding='utf-8'))
    assert {stage for hook in hooks for stage in hook['stages']} == set(configuration['default_install_hook_types'])
