"""The README: every command in it is run, every figure in its table comes out."""

import re
from pathlib import Path
from time import monotonic, sleep

import pytest

DOMAIN = 63
ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / 'README.md').read_text(encoding='utf-8')
BLOCKS = re.findall(r'```bash( cell)?\n(.*?)```', README, flags=re.DOTALL)
COMMANDS = [(bool(stays), line) for stays, block in BLOCKS for line in block.splitlines()]
# what a command that ends by itself must have printed
EXPECTED = {
    'ros2 node list': '/pkm/joint_controller_d7',
    'ros2 topic list -t': '/pkm/d1/encoder [pkm_interfaces/msg/EncoderSample]',
    'motion: four_dof_70ms': 'Goal finished with status: SUCCEEDED',
    'poses:': 'Goal finished with status: SUCCEEDED',
    'param get': 'String value is: d1',
    'service call /pkm/machine/reset': 'success=True',
}


@pytest.fixture
def checkout(processes):
    """Return `processes` in a folder from which the README's commands work, but which is not the checkout."""
    (processes.folder / 'bringup_scripts').symlink_to(ROOT / 'bringup_scripts')
    return processes


def rows(text):
    """Return [axis, cycle, figures...] of the rows of a printed table."""
    table, axis = [], ''
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip('│').split('│')]
        if len(cells) >= 6 and (cells[0] == '' or re.fullmatch(r'd\d', cells[0])) and line.startswith('│'):
            axis = cells[0] or axis
            table.append([axis, *map(float, cells[1:6])])
    return table


def test_main_job_prints_the_figures_of_the_readme(checkout):
    command = next(line for _, line in COMMANDS if line.startswith('bringup_scripts/run'))
    done = checkout.run(*command.split())
    assert done.returncode == 0, done.stderr
    printed, promised = rows(done.stdout), rows(README)
    assert len(printed) == len(promised) == 8
    for ours, theirs in zip(printed, promised, strict=True):
        assert ours[:2] == theirs[:2]
        # sines differ in the last bit between kinds of processors, and the encoder rounds: figures may move a little
        assert ours[2] == pytest.approx(theirs[2], abs=0.5), 'max dynamic error [um]'
        assert ours[3] == pytest.approx(theirs[3], abs=2.0), 'settling to 5 um [ms]'
    assert ' 0 lost' in done.stdout


def test_commands_for_a_cell_that_stays_do_what_the_readme_says(checkout):
    stays = next(line for stays, line in COMMANDS if stays)
    checkout.start('bash', '-c', f'exec {stays}')
    wait_for_node(checkout, '/pkm/trajectory_generator')
    commands = [line for stays, line in COMMANDS if not stays and 'ros2' in line and ' run ' not in line]
    assert commands
    for command in commands:
        done = checkout.run('bash', '-c', command)
        assert done.returncode == 0, f'{command}\n{done.stdout}{done.stderr}'
        expected = [text for key, text in EXPECTED.items() if key in command]
        assert expected, f'nothing is expected of {command}'
        assert expected[0] in done.stdout, f'{command}\n{done.stdout}{done.stderr}'


def test_single_node_starts_under_the_name_it_is_given(checkout):
    command = next(line for stays, line in COMMANDS if not stays and ' run pkm_nodes' in line)
    checkout.start('bash', '-c', f'exec {command}')
    wait_for_node(checkout, '/pkm/joint_controller_d3')


def test_every_command_is_covered():
    covered = ('bringup_scripts/run', 'bringup_scripts/ros2')
    others = [line for _, line in COMMANDS if not line.startswith(covered)]
    assert others == ['bringup_scripts/test']
    assert '\nbringup_scripts/test\n' in (ROOT / '.ci' / 'run').read_text(), 'CI is the run of the test command'


@pytest.mark.parametrize('target', sorted(set(re.findall(r'\]\((?!http)([^)#]+)\)', README))))
def test_link_leads_somewhere(target):
    assert (ROOT / target).exists()


def wait_for_node(checkout, name):
    deadline = monotonic() + 60.0  # starting up on a busy two-core machine
    while name not in checkout.run('bringup_scripts/ros2', 'node', 'list').stdout:
        assert monotonic() < deadline, f'{name} did not come up; log: {(checkout.folder / "log").read_text()}'
        sleep(0.5)
