"""docs/parameters.md is the output of `pkm parameters` and has every configuration file."""

import sys
from pathlib import Path

from pkm_core.config import Configuration
from pkm_core.verbs.config_page import FILES

DOMAIN = 122
PKM = Path(sys.prefix) / 'bin' / 'pkm'
PAGE = Path(__file__).parents[2] / 'docs' / 'parameters.md'


def test_page_is_current(processes):
    done = processes.run(PKM, 'parameters')
    assert done.returncode == 0, done.stderr
    assert done.stdout == PAGE.read_text(), 'update it: .venv/bin/pkm parameters --out docs/parameters.md'


def test_every_kind_of_file_is_documented():
    page = PAGE.read_text()
    for path in Configuration.of_environment().folder.glob('*/*.yaml'):
        titles = [title for title in FILES if title.startswith(f'config/{path.parent.name}')]
        named = [title for title in titles if title.endswith('.yaml')]  # files of a folder that differ in kind
        assert titles, path
        general = f'config/{path.parent.name}' in titles
        assert not named or general or any(title.endswith(path.name) for title in named), path
        assert all(f'### {title}\n' in page for title in titles)
