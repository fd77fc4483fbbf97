"""
The README and the pages of docs: every command and every file in them is run, and the printed figures are compared.

A page is run from top to bottom in an empty folder: bash line by line; a block below a line that names a file and ends
with a colon is written to that file. A process of a block marked `stays` runs until its section ends. EXEMPT lists the
commands that are not run, with the reason.
"""

import ast
import json
import re
import shutil
import sys
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from time import monotonic, sleep

import pytest
from mcap.reader import make_reader

DOMAIN = 63
ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]
RUNNABLE = {'bash', 'python'}
SLOW = ['docs/control.md', 'docs/design.md']
# (page, beginning of a command): reason why it is not run
EXEMPT = {
    ('README.md', 'bringup_scripts/test'): 'it runs this test; CI runs it',
    ('docs/control.md', 'ros2 launch '): 'the wheels have no launch; test/nodes/test_launch.py reads the file',
    ('docs/frames.md', 'ros2 launch '): 'the wheels have no launch; test/nodes/test_launch.py reads the file',
    ('docs/launch.md', 'ros2 '): 'the wheels have no launch; test/nodes/test_launch.py reads the file',
    ('docs/docker.md', 'docker '): 'there is no Docker engine; test/repository/test_docker.py reads the files',
    ('docs/docker.md', 'PKM_SECURITY=true '): 'there is no Docker engine',
    ('docs/docker.md', 'BASE='): 'there is no Docker engine',
    ('docs/docker.md', 'mkdir '): 'it is for a container',
    ('docs/docker.md', 'export PKM_USER'): 'it is for a container',
    ('docs/servo_tick.md', '.venv/bin/uv pip install '): 'it fetches from the network',
    ('docs/reliability.md', 'bringup_scripts/campaign '): 'it takes 30 minutes; test_campaign.py tests its frame',
    ('docs/servo_tick.md', '.venv/bin/pkm bench '): 'it takes many minutes; test_bench.py runs one turn of it',
}
if find_spec('control_msgs') is None:
    for command in (
        '.venv/bin/python follow_client.py',
        'bringup_scripts/ros2 run pkm_nodes cell --ros-args -p folder:=runs/follow',
    ):
        EXEMPT['docs/commands.md', command] = 'control_msgs is not among the wheels'
# part of a command: text it must print
EXPECTED = {
    'run --': ' 0 lost',
    'ros2 node list': '/pkm/joint_controller_d7',
    'ros2 topic list -t': '/pkm/d1/encoder [pkm_interfaces/msg/EncoderSample]',
    'motion: four_dof_70ms': 'Goal finished with status: SUCCEEDED',
    'poses:': 'Goal finished with status: SUCCEEDED',
    'action/GoTo': 'Goal finished with status: SUCCEEDED',
    'action/Home': 'Goal finished with status: SUCCEEDED',
    'pkm go-to': 'the machine stands at x 89.5000 mm, y 91.5000 mm, z 124.0000 mm',
    'pkm home': 'the machine stands at home',
    'trajectory_client.py': 'finished',
    'follow_client.py': 'error code 0 \nstates in the feedback: some',
    'jog_client.py': 'finished',
    'param get': 'String value is: d1',
    'param set': 'Set parameter successful',
    'service call /pkm/machine/reset': 'success=True',
    'service call /pkm/machine/pause': 'success=True',
    'pkm report': 'report.html',
    'pkm calibrate': 'the calibrated machine is ',  # calibrate-cell too
    'pkm convergence': '',
    'bringup_scripts/setup': '',
    'export PATH': '',
    'topic info': 'Publisher count: 1',
    'interface show': 'uint64 tick',
    'bag info': 'Topic: /pkm/d1/encoder | Type: pkm_interfaces/msg/EncoderSample',
}
BLOCK = re.compile(r'(?P<above>[^\n]*)\n```(?P<kind>\w+)(?P<mark>[^\n]*)\n(?P<text>.*?)^```$', re.DOTALL | re.MULTILINE)


def name_of(page):
    """Return the path of `page` below the root."""
    return page.relative_to(ROOT).as_posix()


def sections(page):
    """Return the blocks of `page` as matches of `BLOCK`, one list per section."""
    text = page.read_text(encoding='utf-8')
    prose = re.sub(r'^```.*?^```$', lambda block: ' ' * len(block[0]), text, flags=re.DOTALL | re.MULTILINE)
    starts = [0, *(heading.start() for heading in re.finditer(r'^#+ ', prose, re.MULTILINE)), len(text)]
    return [list(BLOCK.finditer(text, start, end)) for start, end in pairwise(starts)]


def commands(block):
    """Return the commands of a bash block: continued lines joined, comments dropped."""
    lines = block['text'].replace('\\\n', ' ').splitlines()
    return [line for line in lines if line.strip() and not line.startswith('#')]


def file_of(block):
    """Return the name of the file that a block holds, '' if it holds none."""
    names = re.findall(r'`(\w+\.(?:py|yaml))`', block['above']) if block['above'].endswith(':') else []
    return names[-1] if names else ''


@pytest.fixture
def checkout(processes):
    """Return `processes` in a folder outside the checkout in which the commands of the pages work."""
    for name in ('bringup_scripts', '.venv'):
        (processes.folder / name).symlink_to(ROOT / name)
    shutil.copytree(ROOT / 'config', processes.folder / 'config')  # pages change copies only
    path = [Path(sys.prefix) / 'bin', ROOT / 'bringup_scripts']
    processes.environment['PATH'] = ':'.join([*map(str, path), processes.environment['PATH']])
    return processes


@pytest.mark.timeout(900)  # several cells in sequence
@pytest.mark.parametrize(
    'page',
    [
        pytest.param(page, marks=[pytest.mark.slow] * (name_of(page) in SLOW), id=name_of(page))
        for page in PAGES
        if RUNNABLE & {block['kind'] for section in sections(page) for block in section}
    ],
)
def test_commands_of_a_page_run_and_print_its_figures(checkout, page):
    for section in sections(page):
        stay, starting = [], None
        for block in section:
            name = file_of(block)
            if name:
                (checkout.folder / name).write_text(block['text'])
            elif block['kind'] == 'python':
                run_imports(block['text'])  # a sketch: its names are placeholders
            for command in commands(block) if block['kind'] == 'bash' else ():
                if any(key[0] == name_of(page) and command.startswith(key[1]) for key in EXEMPT):
                    continue
                if block['mark'] == ' stays':
                    starting = checkout.start('bash', '-c', f'exec {command}', log='stays')
                    stay.append(starting)
                    continue
                if starting and 'pkm run' not in command:  # pkm run waits by itself
                    wait_until_up(checkout, starting)
                run(checkout, command)
                starting = None
        if starting:
            wait_until_up(checkout, starting)
        for process in stay:
            checkout.stop(process)
    CLAIMS.get(name_of(page), lambda folder: None)(checkout.folder)


def run(checkout, command):
    """Run a command to its end; it must return 0 and print the text of EXPECTED."""
    done = checkout.run('bash', '-c', command)
    assert done.returncode == 0, f'{command}\n{done.stdout}{done.stderr}'
    expected = [text for part, text in EXPECTED.items() if part in command]
    assert expected or command.startswith(('cp ', 'sed ')), f'nothing is expected of {command}'
    assert all(text in done.stdout for text in expected), f'{command}\n{done.stdout}{done.stderr}'


def run_imports(text):
    """Run the import statements of a Python block; the whole block must parse."""
    lines = [node for node in ast.parse(text).body if isinstance(node, ast.Import | ast.ImportFrom)]
    exec(compile(ast.Module(lines, []), 'imports', 'exec'), {})


def wait_until_up(checkout, process):
    """Wait until two consecutive node lists are equal."""
    seen, deadline = '', monotonic() + 60.0  # starting up on a busy two-core machine
    while True:
        now = checkout.run('ros2', 'node', 'list').stdout
        if now.strip() and now == seen:
            return
        log = (checkout.folder / 'stays').read_text()
        assert process.poll() is None, log
        assert monotonic() < deadline, log
        seen = now
        sleep(0.5)


def test_every_block_is_of_a_known_kind():
    """A session of Python (pycon) is that of a docstring, which test_doctest.py runs."""
    for page in PAGES:
        for block in (block for section in sections(page) for block in section):
            assert block['kind'] in RUNNABLE | {'yaml', 'text', 'math', 'pycon'}, block[0]
            assert block['mark'] in ('', ' stays'), block[0]


def test_every_exemption_is_needed():
    for name, beginning in EXEMPT:
        page = ROOT / name
        blocks = [block for section in sections(page) for block in section if block['kind'] == 'bash']
        assert any(command.startswith(beginning) for block in blocks for command in commands(block)), (name, beginning)
    assert '\nbringup_scripts/test\n' in (ROOT / '.ci' / 'run').read_text(), 'CI is the run of the test command'


@pytest.mark.slow
def test_page_shows_the_fault_text_of_a_silent_controller(checkout):
    page = ROOT / 'docs' / 'own_controller.md'
    blocks = [block for section in sections(page) for block in section]
    (checkout.folder / 'my_controller.py').write_text(next(b['text'] for b in blocks if file_of(b)))
    controller = checkout.start('python', 'my_controller.py', log='stays')
    words = ('--without', 'joint_controller_d3', '--law', 'none', '--cycles', 1000, '--out', 'out')
    run = checkout.start('pkm', 'run', *words, log='run')
    deadline = monotonic() + 90.0
    while len(list(checkout.folder.glob('out/bags/*'))) < 2:
        assert monotonic() < deadline, (checkout.folder / 'run').read_text()
        sleep(0.1)
    controller.kill()
    assert run.wait(timeout=60) == 1
    promised = re.search(r'machine: tick \d+ (\(.*\)): no answer .*', page.read_text())[0]
    pattern = re.sub(r'\d+', r'\\d+', re.escape(promised)).replace(r'\.', '.')
    assert re.search(pattern, (checkout.folder / 'run').read_text())


# figures of the pages


def figures(folder, run):
    """Return [{joint: figures}] of the cycles of a run."""
    return [cycle['axes'] for cycle in json.loads((folder / 'runs' / run / 'results.json').read_text())['cycles']]


def errors(folder, run, cycle):
    """Return {joint: largest dynamic error [um]}."""
    return {joint: axis['max_dynamic_error_um'] for joint, axis in figures(folder, run)[cycle].items()}


def row(page, beginning):
    """Return the cells of a table row after its first; figures as numbers."""
    text = (ROOT / 'docs' / page).read_text(encoding='utf-8')
    line = next(line for line in text.splitlines() if line.startswith(f'| {beginning}'))
    cells = [cell.strip() for cell in line.strip('|').split('|')][1:]
    return [float(cell) if re.fullmatch(r'-?[\d.]+', cell) else cell for cell in cells]


def claims_of_readme(folder):
    table, tool, axis = [], {}, ''
    for line in PAGES[0].read_text(encoding='utf-8').splitlines():
        cells = [cell.strip() for cell in line.strip('│').split('│')]
        if line.startswith('│') and len(cells) >= 6 and (cells[0] == '' or re.fullmatch(r'd\d', cells[0])):
            axis = cells[0] or axis
            table.append((axis, *map(float, cells[1:4])))
        elif line.startswith('│') and '->' in line:
            tool[cells[0]] = [list(map(float, cell.split('->'))) for cell in cells[1:]]
    assert len(table) == 8
    cycles = figures(folder, 'first')
    for axis, cycle, error, settling in table:
        measured = cycles[int(cycle) - 1][axis]
        # sines differ in the last bit between processor types, and the encoder rounds
        assert measured['max_dynamic_error_um'] == pytest.approx(error, abs=0.5)
        assert measured['settling_5um_ms'] == pytest.approx(settling, abs=2.0)
    results = json.loads((folder / 'runs' / 'first' / 'results.json').read_text())
    assert tuple(tool) == ('x', 'y', 'z', 'phi')
    for name, columns in tool.items():
        for figure, shown in zip(('moves_rms_um', 'moves_largest_um', 'rests_rms_um'), columns, strict=False):
            first, last = (results['cycles'][cycle]['tool'][name][figure] for cycle in (0, -1))
            assert [first, last] == pytest.approx(shown, abs=1.0)  # one step of the laser


def claims_of_own_controller(folder):
    for run, beginning in (('robust', 'robust control (7.24)'), ('mine', 'my_controller.py')):
        error, settling, rest = row('own_controller.md', beginning)
        measured = figures(folder, run)[0]['d3']
        assert measured['max_dynamic_error_um'] == pytest.approx(error, abs=0.5)
        assert measured['steady_state_error_um'] == pytest.approx(rest, abs=0.5)
        assert (measured['settling_5um_ms'] is None) == (settling == 'never')
    text = (ROOT / 'docs' / 'own_controller.md').read_text(encoding='utf-8')
    before, after = map(float, re.search(r'brings d3 from ([\d.]+) um to ([\d.]+) um in eight cycles', text).groups())
    assert errors(folder, 'learned', 0)['d3'] == pytest.approx(before, abs=0.5)
    assert errors(folder, 'learned', 7)['d3'] == pytest.approx(after, abs=0.5)


def claims_of_own_drive(folder):
    assert list(errors(folder, 'my_machine', 0).values()) == pytest.approx(
        row('own_drive.md', 'my_machine.py'), abs=0.5
    )
    expected = row('own_drive.md', 'node `machine`')
    text = (ROOT / 'docs' / 'own_drive.md').read_text(encoding='utf-8')
    before, after = map(float, re.search(r'grows from ([\d.]+) to ([\d.]+) um', text).groups())
    assert before == expected[1]
    expected[1] = after
    assert list(errors(folder, 'my_drive', 0).values()) == pytest.approx(expected, abs=0.5)


def claims_of_tutorial(folder):
    """Foxglove and PlotJuggler need the definition of every type in the file."""
    files = sorted(folder.glob('runs/bags/*/*.mcap'))
    assert len(files) == 3
    for file in files:
        with file.open('rb') as stream:
            reader = make_reader(stream)
            assert reader.get_header().profile == 'ros2'
            summary = reader.get_summary()
        assert summary.channels
        for channel in summary.channels.values():
            schema = summary.schemas[channel.schema_id]
            assert (channel.message_encoding, schema.encoding) == ('cdr', 'ros2msg')
            assert schema.data


CLAIMS = {
    'README.md': claims_of_readme,
    'docs/tutorial.md': claims_of_tutorial,
    'docs/own_controller.md': claims_of_own_controller,
    'docs/own_drive.md': claims_of_own_drive,
}
