"""
The prose of the project is plain technical English: the phrases of `BANNED` do not occur in it.

Prose is the documentation, the docstrings, messages and comments of the code, and the comments of interfaces,
configuration and scripts. Code in it, between backticks, is not prose.
"""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted([*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md')])
CODE = sorted(
    path for folder in ('src', 'docker', 'docs') for path in (ROOT / folder).rglob('*.py') if not path.is_symlink()
)
SCRIPTS = [
    *(ROOT / 'bringup_scripts').iterdir(),
    ROOT / '.ci' / 'run',
    *(ROOT / 'docker').glob('*'),
    *ROOT.glob('.*.yaml'),
]
COMMENTED = sorted(
    [
        *(path for kind in ('msg', 'srv', 'action') for path in (ROOT / 'src' / 'pkm_interfaces').rglob(f'*.{kind}')),
        *(ROOT / 'config').rglob('*.yaml'),
        *(path for path in SCRIPTS if path.suffix in ('', '.yaml', '.sh', '.dockerignore')),
    ]
)
WITHIN_A_PARAGRAPH = r'(?:[ \t]+|[ \t]*\n[ \t]*)'
PREPOSITION = 'and|as|by|for|from|has|if|in|is|of|on|or|per|that|to|when|while|with|without'
RATED = 'sample|tick|joint|axis|node|cycle|message|process|batch|row|line|file|volt|pitch|pass'

# regular expression, at word boundaries, case ignored, a space matching one line end: what to write instead
BANNED = {
    # archaic and literary
    'anew': 'again, restart',
    'afresh': 'again, restart',
    'amid': 'during, within',
    'in the midst': 'during, within',
    'to be had': 'available',
    '(what|whatever) (comes|came) of (it|them)': 'the result',
    'nobody can': 'it is unknown',
    'for good': 'permanently',
    '(goes|go|going|went) on': 'continues',
    'for ever': 'without a limit',
    'story': 'events',
    'word on (it|that|a|the)': 'message, event',
    'without a word': 'without a message',
    'a late word': 'a late message',
    'will do(?=[.,;:)])': 'is sufficient',
    "of one's own": 'custom, your own',
    'comes? out': 'is the result',
    'as it (is|was) (found|told|asked for)': 'measured, reported, requested',
    'as (told|asked for)': 'reported, requested',
    'has changed its ways': 'has changed its behaviour',
    'beside itself': 'self-contained',
    'how rough the world': 'level of imperfections',
    'by itself says': 'state the fact',
    'given back': 'returned, restored',
    # persons instead of things
    'whoever|whomever|whosoever': 'the node that, a subscriber that',
    'somebody|someone|anybody|anyone': 'a node, a user, a reader',
    'nobody|no one': 'no node, nothing',
    'everybody|everyone': 'every node, every reader',
    'who leads': 'the trajectory source',
    'says? nothing': 'does not reply',
    # speaking things
    '(have|has|had) to (tell|say)': 'contains, reports',
    'tells?': 'returns, reports, shows',
    'says?': 'states, reports',
    'say and hear': 'publish and subscribe',
    'hears?|heard': 'receives, subscribes to',
    # rates
    f'(an?|one|two|three) ((?!(?:{PREPOSITION}) )\\w+ )?an? ({RATED})': 'one per sample',
    # targets
    'to be reached': 'target',
    'what ([\\w-]+ ){1,8}is worth': 'accuracy, benefit',
}
BANNED_PATTERNS = {
    re.compile(r'\b(?:' + phrase.replace(' ', WITHIN_A_PARAGRAPH) + r')\b', re.IGNORECASE): phrase for phrase in BANNED
}


def prose_of_document(text):
    """Return Markdown without its code: code has a language of its own."""
    return re.sub(r'^```.*?^```$|`[^`\n]*`', '_', text, flags=re.MULTILINE | re.DOTALL)


def prose_of_code(text):
    """Return the docstrings, string literals and comments of Python; `_` stands for names between backticks."""
    tree = ast.parse(text)
    strings = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return re.sub(r'`[^`\n]*`', '_', '\n\n'.join([*strings, *comments_of(text)]))


def comments_of(text):
    """Return the comments of Python; lines of comment that follow each other are one."""
    comments, below = [], -1
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            words, line = token.string.lstrip('# '), token.start[0]
            alone = token.line.lstrip().startswith('#')
            if alone and line == below:
                comments[-1] += f'\n{words}'
            else:
                comments.append(words)
            below = line + 1 if alone else -1
    return comments


def prose_of_comments(text):
    """Return the comments of an interface, YAML file or script, one below the other."""
    return '\n'.join(comment.lstrip('# ') for comment in re.findall(r'(?:^|\s)#(.*)', text))


def banned_in(prose):
    """Return ['phrase: what stands there (instead: ...)'] of every banned phrase in `prose`."""
    return [
        f'{" ".join(prose[max(0, found.start() - 30) : found.end() + 30].split())!r}; instead: {BANNED[phrase]}'
        for pattern, phrase in BANNED_PATTERNS.items()
        for found in pattern.finditer(prose)
    ]


def path_of(path):
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize('path', DOCUMENTS, ids=path_of)
def test_document_has_no_banned_phrase(path):
    assert banned_in(prose_of_document(path.read_text(encoding='utf-8'))) == []


@pytest.mark.parametrize('path', CODE, ids=path_of)
def test_code_has_no_banned_phrase(path):
    assert banned_in(prose_of_code(path.read_text(encoding='utf-8'))) == []


@pytest.mark.parametrize('path', COMMENTED, ids=path_of)
def test_comments_have_no_banned_phrase(path):
    assert banned_in(prose_of_comments(path.read_text(encoding='utf-8'))) == []


@pytest.mark.parametrize(
    ('prose', 'count'),
    [
        ('Start the cell anew.', 1),
        ('a row a sample, one a node', 2),
        ('It goes\non in the Midst of a cycle.', 2),
        ('nobody answers, whoever listens', 2),
        ('renewed gains of one axis per node, one that a node declares', 0),
    ],
)
def test_banned_phrases_are_found_at_word_boundaries(prose, count):
    assert len(banned_in(prose)) == count


def test_prose_of_code_is_strings_docstrings_and_comments():
    code = '"""Docstring."""\n# first\n# line\nname = f"message {value} `code`"  # comment\n'
    assert prose_of_code(code).split('\n\n') == ['Docstring.', 'message ', ' _', 'first\nline', 'comment']
