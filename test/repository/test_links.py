"""Everything that the README and docs name exists: files, headings, images, tests, commands, code in `code` columns."""

import re
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from urllib.parse import unquote

import pytest
import typer

ROOT = Path(__file__).resolve().parents[2]
PAGES = [*sorted(ROOT.glob('*.md')), *sorted((ROOT / 'docs').rglob('*.md'))]
LINK = re.compile(r'!?\[[^\]]*\]\(([^)\s]+)\)')
INLINE = re.compile(r'(?<![\\$\w])\$(?=\S)([^$]+)\$(?!\w)')
CODE = re.compile(r'^```.*?^```$|`[^`\n]*`', re.MULTILINE | re.DOTALL)


def links(page):
    return LINK.findall(CODE.sub('', page.read_text(encoding='utf-8')))


def anchors(page):
    """Return the anchors of a page's headings, as GitHub forms them."""
    headings = re.findall(r'^#+ +(.*?) *$', page.read_text(encoding='utf-8'), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    for link in links(page):
        if link.startswith(('http://', 'https://', 'mailto:')):
            continue  # external pages change
        path, _, anchor = unquote(link).partition('#')
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f'{page.name}: {link}'
        assert target.is_relative_to(ROOT), f'{page.name}: {link} leads out of the tree'
        assert not anchor or anchor in anchors(target), f'{page.name}: {link}'


def test_readme_has_at_most_100_lines():
    assert len((ROOT / 'README.md').read_text(encoding='utf-8').splitlines()) <= 100


def test_every_page_can_be_reached_from_the_readme():
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


def test_index_lists_every_page_of_docs():
    index = ROOT / 'docs' / 'README.md'
    listed = {unquote(link).partition('#')[0] for link in links(index)}
    assert {page.name for page in (ROOT / 'docs').glob('*.md')} - {index.name} <= listed


def test_paths_in_code_exist():
    """A path of this tree between backticks exists."""
    for page in PAGES:
        for path in re.findall(r'`((?:src|config|docs|test|bringup_scripts|docker)/[\w./-]+)`', page.read_text()):
            assert (ROOT / path.rstrip('/')).exists(), f'{page.name}: {path}'


def formulas(page):
    """Return the inline formulas and the block formulas of a page."""
    text = page.read_text(encoding='utf-8')
    return INLINE.findall(CODE.sub('', text)), re.findall(r'^```math\n(.*?)^```$', text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_formulas_survive_markdown(page):
    """Inline, Markdown consumes stars and a backslash before punctuation; blocks are left unchanged."""
    inline, blocks = formulas(page)
    for formula in inline:
        assert not re.search(r'\\[^a-zA-Z]|\*', formula), f'{page.name}: {formula}'
    for formula in (*inline, *blocks):
        braces = re.sub(r'\\[{}]', '', formula)
        assert braces.count('{') == braces.count('}'), f'{page.name}: {formula}'
        assert re.findall(r'\\begin{(\w+)}', formula) == re.findall(r'\\end{(\w+)}', formula), f'{page.name}: {formula}'


def test_tests_named_by_the_pages_exist():
    """A name between backticks that begins with test_; an abbreviated one ends with an ellipsis."""
    defined = {
        name
        for path in (ROOT / 'test').rglob('test_*.py')
        for name in [path.stem, *re.findall(r'^def (test_\w+)', path.read_text(encoding='utf-8'), re.MULTILINE)]
    }
    for page in PAGES:
        for name, cut in re.findall(r'`(test_\w+?)(_\.\.\.)?`', page.read_text(encoding='utf-8')):
            known = any(each.startswith(name) for each in defined) if cut else name in defined
            assert known, f'{page.name}: {name}'


def test_commands_between_backticks_have_known_options():
    """Verb and options of every `pkm VERB ...` within a line; blocks are run by test_docs.py."""
    verbs = {entry.name: entry for entry in entry_points(group='pkm.verbs')}
    options, found = {}, 0
    for page in PAGES:
        for verb, rest in re.findall(r'`(?:\.venv/bin/)?pkm ([a-z][\w-]*)([^`\n]*)`', page.read_text(encoding='utf-8')):
            assert verb in verbs, f'{page.name}: pkm {verb}'
            if verb not in options:
                options[verb] = options_of(verbs[verb].load())
            unknown = set(re.findall(r' (--[\w-]+)', rest)) - options[verb]
            assert not unknown, f'{page.name}: pkm {verb}{rest}: unknown {unknown}'
            found += 1
    assert found > 30


def options_of(verb):
    """Return the options of a function that is a verb of `pkm`."""
    app = typer.Typer()
    app.command()(verb)
    return {option for parameter in typer.main.get_command(app).params for option in parameter.opts}


def test_code_named_in_tables_exists():
    """In a column `code`, names between backticks are modules of pkm_core or their attributes."""
    found = 0
    for page in PAGES:
        column = None
        for line in page.read_text(encoding='utf-8').splitlines():
            cells = [cell.strip() for cell in line.strip('|').split('|')] if line[:1] == '|' else []
            if 'code' in cells:
                column = cells.index('code')
            elif not cells:
                column = None
            elif column is not None:
                for name in re.findall(r'`([\w.]+)`', cells[column]):
                    assert exists(name), f'{page.name}: {name}'
                    found += 1
    assert found > 15


def exists(name):
    """Return whether `name` is a module of pkm_core, or an attribute (of an attribute) of one."""
    parts = name.split('.')
    for end in range(len(parts), 0, -1):
        if (ROOT / 'src/pkm_core/pkm_core' / '/'.join(parts[:end])).with_suffix('.py').exists():
            found = import_module('.'.join(['pkm_core', *parts[:end]]))
            for attribute in parts[end:]:
                if not hasattr(found, attribute):
                    return False
                found = getattr(found, attribute)
            return True
    return False
