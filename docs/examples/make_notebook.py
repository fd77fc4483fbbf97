"""
Make the notebook of an example: `python docs/examples/make_notebook.py > docs/examples/01_first_motion.ipynb`.

The cells are those of the script, which `# %%` separates. What a notebook does not need is left out: the folder of the
figures, which it shows instead.
"""

import ast
import json
import re
from pathlib import Path

SCRIPT = Path(__file__).with_name('01_first_motion.py')
FOLDER = re.compile(r'^(import sys|import tempfile|from pathlib import Path|folder = .*)\n', re.MULTILINE)
SAVED = re.compile(r'\.savefig\(.*\)$', re.MULTILINE)


def notebook(script):
    """Return the text of the notebook of the example `script`."""
    text = script.read_text(encoding='utf-8')
    head = (ast.get_docstring(ast.parse(text)) or '').partition(' Figures go')[0]
    code = text.partition('"""\n\n')[2]
    cells = [SAVED.sub('', FOLDER.sub('', cell)).strip() for cell in code.split('# %%\n')]
    cells[0] = f'%matplotlib inline\n{cells[0]}'
    document = {
        'cells': [_cell(0, 'markdown', f'# {head}'), *(_cell(i, 'code', cell) for i, cell in enumerate(cells, 1))],
        'metadata': {'kernelspec': {'display_name': 'Python 3', 'language': 'python', 'name': 'python3'}},
        'nbformat': 4,
        'nbformat_minor': 5,
    }
    return json.dumps(document, indent=1) + '\n'


def _cell(number, kind, text):
    code = {'execution_count': None, 'outputs': []} if kind == 'code' else {}
    return {'cell_type': kind, 'id': f'cell-{number}', 'metadata': {}, 'source': text.splitlines(keepends=True)} | code


if __name__ == '__main__':
    print(notebook(SCRIPT), end='')
