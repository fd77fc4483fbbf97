"""
`pkm page` with a real cell, operated by clicks in headless Chromium.

PKM_SCREENSHOT=docs/page.png updates the picture of the README.
"""

import os
import re
import signal
import socket
import sys
from pathlib import Path

import pytest

from pkm_nodes.graph import cell_nodes

DOMAIN = 81
BIN = Path(sys.prefix) / 'bin'
CELL = Path(sys.prefix) / 'lib' / 'pkm_nodes' / 'cell'
CHROMIUM = Path('/usr/bin/chromium')
# [ms] everything below takes seconds; the rest is reserve for a busy machine that also draws the picture by itself
PATIENCE = 90_000

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM.exists(), reason=f'no {CHROMIUM}: apt-get install chromium'),
]
sync_api = pytest.importorskip('playwright.sync_api')
sync_api.expect.set_options(timeout=PATIENCE)


@pytest.fixture(scope='module')
def port():
    """Return a free port."""
    with socket.create_server(('127.0.0.1', 0)) as probe:
        return probe.getsockname()[1]


class Cell:
    """The composed cell of this module, with restart."""

    def __init__(self, processes):
        self._processes = processes
        self.start()

    def start(self):
        bags = self._processes.folder / 'bags'
        self._process = self._processes.start(CELL, '--ros-args', '-p', f'folder:={bags}', log='cell.log')

    def end(self):
        self._process.send_signal(signal.SIGINT)
        assert self._process.wait(30) == 0


@pytest.fixture(scope='module')
def cell(module_processes):
    return Cell(module_processes)


@pytest.fixture(scope='module')
def requests():
    """Return the list of requests of the browser."""
    return []


@pytest.fixture(scope='module')
def window(module_processes, cell, port, requests, tmp_path_factory):
    """Return the page in a browser when it shows a cell at rest."""
    module_processes.start(BIN / 'pkm', 'page', '--port', port, log='page.log')
    flags = '--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking'
    flags += ' --disable-component-update --disable-sync --use-gl=angle --use-angle=swiftshader'
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch_persistent_context(
            tmp_path_factory.mktemp('profile'),
            executable_path=CHROMIUM,
            args=[*flags.split(), '--enable-unsafe-swiftshader'],
            viewport={'width': 1200, 'height': 920},
        )
        window = browser.pages[0]
        window.set_default_timeout(PATIENCE)
        window.on('request', lambda request: requests.append(request.url))
        _open(window, f'http://127.0.0.1:{port}')
        status(window).filter(has_text='standing').wait_for()
        yield window
        browser.close()


def _open(window, address):
    """Open `address`; retry until the server listens."""
    for _ in range(60):
        try:
            return window.goto(address)
        except sync_api.Error:
            window.wait_for_timeout(500)
    return window.goto(address)


def status(window):
    return window.locator('[data-status]')


def notice(window, text):
    """Wait for a reply of the cell that matches `text` (a regular expression), and return it."""
    found = window.locator('[data-notice]').filter(has_text=re.compile(text))
    found.wait_for()
    return found.inner_text()


def press(window, name):
    window.get_by_role('button', name=name, exact=True).click()


def type_into(window, field, text):
    field.fill(text)
    field.press('Enter')
    field.blur()


def run(window, cycles):
    type_into(window, window.get_by_label('cycles'), str(cycles))
    press(window, 'Run')


def test_page_loads_with_nothing_from_the_internet(window, requests, port):
    window.get_by_text('Error of the latest cycle').wait_for()
    assert window.locator('canvas').first.bounding_box()['width'] > 300
    assert all(re.match(rf'(blob:)?http://127\.0\.0\.1:{port}/|data:', url) for url in requests), requests


def test_every_node_of_the_cell_is_up(window):
    rows = window.locator('[data-nodes] tr')
    motors_laser_and_cell = 6  # parts of the machine, and the node that holds the parameters of a composed cell
    sync_api.expect(rows).to_have_count(len(cell_nodes('four_dof')) + motors_laser_and_cell)
    sync_api.expect(rows.filter(has_text=re.compile('missing|of that name'))).to_have_count(0)
    sync_api.expect(rows.filter(has_text='machine')).to_have_text(re.compile('standing$'))
    sync_api.expect(rows.filter(has_text='recorder')).to_have_text(re.compile('recording$'))


def test_click_runs_cycles_and_updates_numbers_and_curves(window):
    run(window, 3)
    assert notice(window, ': done$') == 'four_dof_70ms, law fourier_pid: done'
    status(window).filter(has_text='standing, cycle 3').wait_for()
    worst = window.locator('[data-worst]')
    assert 0.1 < float(worst.inner_text()) < 50
    window.get_by_text('Error of the latest cycle [um]: cycle 3', exact=True).wait_for()
    window.get_by_text(re.compile(r'Error of the best cycle \[um\]: cycle [123]$')).wait_for()
    before = worst.inner_text()
    run(window, 4)
    status(window).filter(has_text='standing, cycle 7').wait_for()
    window.get_by_text('Motor currents of the latest cycle [A]: cycle 7', exact=True).wait_for()
    sync_api.expect(worst).not_to_have_text(before)
    _keep_picture(window)


def test_law_selected_in_the_list_runs(window):
    laws = window.get_by_label('law', exact=True)
    laws.fill('norm_optimal')
    laws.press('ArrowDown')
    laws.press('Enter')
    laws.blur()
    run(window, 2)
    notice(window, '^four_dof_70ms, law norm_optimal: done$')
    window.locator('td', has_text='four_dof_70ms, law norm_optimal').wait_for()


def _keep_picture(window):
    path = os.environ.get('PKM_SCREENSHOT')
    if path:
        close = window.locator('#webgl-software-rendering button')
        if close.count():
            close.click()
        window.mouse.move(600, 900)
        window.wait_for_timeout(3000)
        window.screenshot(path=Path(__file__).parents[2] / path)


def test_jog_visits_a_pose(window):
    """A pose out of reach is refused with the reason."""
    x = window.locator('input.mantine-NumberInput-input').nth(1)
    type_into(window, x, '40')
    press(window, 'Visit')
    assert re.search(r'allowed .* to .* mm', notice(window, 'visit: .*allowed'))
    type_into(window, x, '2')
    press(window, 'Visit')
    assert notice(window, 'visit: done') == 'visit: done'
    window.locator('td', has_text='poses, law none').wait_for()
    type_into(window, x, '0')


def test_stop_ends_the_motion_after_its_cycle(window):
    run(window, 900)
    notice(window, r'cycle \d+ of 900 done')  # whichever is seen: they pass quickly
    press(window, 'Stop after this cycle')
    assert 'cancelled after cycle' in notice(window, 'cancelled')
    press(window, 'Stop after this cycle')
    notice(window, 'no goal is running')


def test_reset_shows_the_reply_of_the_machine(window):
    press(window, 'Reset after a fault')
    assert notice(window, '^reset') == 'reset: at home; there was no fault'


def test_page_survives_a_restart_of_the_graph(window, cell):
    cell.end()
    status(window).filter(has_text='waiting for a cell in /pkm').wait_for()
    window.locator('[data-nodes]').get_by_text('missing').first.wait_for()
    press(window, 'Run')
    notice(window, 'no trajectory_generator offers execute_motion')
    cell.start()
    status(window).filter(has_text='standing').wait_for()
    window.locator('[data-nodes]').get_by_text('missing').first.wait_for(state='detached')
    run(window, 1)
    notice(window, ': done$')
    status(window).filter(has_text='standing, cycle 1').wait_for()
    window.get_by_text('Error of the latest cycle [um]: cycle 1', exact=True).wait_for()


def test_port_in_use_is_refused_with_one_line(window, module_processes, port):
    refused = module_processes.run(BIN / 'pkm', 'page', '--port', port)
    assert refused.returncode == 1
    assert refused.stdout == ''
    expected = (
        f'pkm: page: cannot listen on 127.0.0.1 port {port}: Address already in use; choose another with --port\n'
    )
    assert refused.stderr == expected
