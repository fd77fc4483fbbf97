"""Every link of the README and of docs leads to a file of this tree, and every heading and image it names exists."""

import re
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]
LINK = re.compile(r'!?\[[^\]]*\]\(([^)\s]+)\)')
CODE = re.compile(r'^```.*?^```$|`[^`\n]*`', re.MULTILINE | re.DOTALL)


def links(page):
    return [target for target in LINK.findall(CODE.sub('', page.read_text(encoding='utf-8')))]


def anchors(page):
    """Return what the headings of a page are called in links, as GitHub forms it."""
    headings = re.findall(r'^#+ +(.*?) *$', page.read_text(encoding='utf-8'), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for link in links(page):
        if link.startswith(('http://', 'https://', 'mailto:')):
            continue  # others' pages come and go
        path, _, anchor = unquote(link).partition('#')
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f'{page.name}: {link}'
        assert target.is_relative_to(ROOT), f'{page.name}: {link} leads out of the tree'
        assert not anchor or anchor in anchors(target), f'{page.name}: {link}'


def test_every_page_of_docs_can_be_reached_from_the_readme():
    reached, todo = set(), [ROOT / 'README.md']
    while todo:
        page = todo.pop()
        if page in reached:
            continue
        reached.add(page)
        targets = [
            (page.parent / unquote(link).partition('#')[0]).resolve() for link in links(page) if '://' not in link
        ]
        todo += [target for target in targets if target.suffix == '.md' and target.exists()]
    assert set(PAGES) <= reached


def test_paths_in_code_exist():
    """What is named as a path of this tree between backticks is there."""
    for page in PAGES:
        for path in re.findall(r'`((?:src|config|docs|test|bringup_scripts|docker)/[\w./-]+)`', page.read_text()):
            assert (ROOT / path.rstrip('/')).exists(), f'{page.name}: {path}'
