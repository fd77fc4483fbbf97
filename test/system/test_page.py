"""
`pkm page` with a real cell, operated by clicks in headless Chromium.

The tests also make the pictures of the documentation; `bringup_scripts/pictures` keeps them in docs.
"""

import os
import re
import signal
import socket
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from pkm_nodes.graph import cell_nodes

DOMAIN = 81
BIN = Path(sys.prefix) / 'bin'
CELL = Path(sys.prefix) / 'lib' / 'pkm_nodes' / 'cell'
CHROMIUM = Path('/usr/bin/chromium')
# [ms] everything below takes seconds; the rest is reserve for a busy machine that also draws the picture by itself
PATIENCE = 90_000
WINDOW = {'width': 1440, 'height': 900}
PHONE = {'width': 390, 'height': 844}
# title of every chart and the ends of its x axis
SHOWN = """Object.values(__viserTestpoints.uplots).map(({chart}) =>
  [chart.root.querySelector('.u-title')?.textContent ?? '', chart.scales.x.min, chart.scales.x.max])"""

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
            viewport=WINDOW,
            color_scheme='light',
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


def turn_to(window, tab):
    window.get_by_role('tab', name=tab, exact=True).click()


def run(window, cycles):
    type_into(window, window.get_by_label('cycles'), str(cycles))
    press(window, 'Run')


def test_page_loads_with_nothing_from_the_internet(window, requests, port):
    window.get_by_text('Error [um]', exact=True).wait_for()
    assert window.locator('canvas').first.bounding_box()['width'] > 300
    assert all(re.match(rf'(blob:)?http://127\.0\.0\.1:{port}/|data:', url) for url in requests), requests


def test_every_node_of_the_cell_is_up(window):
    turn_to(window, 'Nodes')
    rows = window.locator('[data-nodes] tr')
    motors_laser_and_cell = 6  # parts of the machine, and the node that holds the parameters of a composed cell
    sync_api.expect(rows).to_have_count(len(cell_nodes('four_dof')) + motors_laser_and_cell)
    sync_api.expect(rows.filter(has_text=re.compile('missing|of that name'))).to_have_count(0)
    sync_api.expect(rows.filter(has_text='machine')).to_have_text(re.compile('standing$'))
    sync_api.expect(rows.filter(has_text='recorder')).to_have_text(re.compile('recording$'))
    turn_to(window, 'Operate')


def test_click_runs_cycles_and_updates_numbers_and_curves(window):
    run(window, 3)
    assert notice(window, ': done$') == 'four_dof_70ms, law fourier_pid: done'
    status(window).filter(has_text='standing, cycle 3').wait_for()
    worst = window.locator('[data-worst]')
    assert 0.1 < float(worst.inner_text()) < 50
    window.get_by_text('Error [um]: cycle 3', exact=True).wait_for()
    window.get_by_text('Error of the tool by laser [um]: cycle 3', exact=True).wait_for()
    window.get_by_text('Learned part of the current [A]: cycle 3', exact=True).wait_for()
    turn_to(window, 'Learning')
    window.get_by_text(re.compile(r'Error of the best cycle \[um\]: cycle [123]$')).wait_for()
    sync_api.expect(window.locator('[data-history] tr')).to_have_count(3)
    turn_to(window, 'Cycle')
    before = worst.inner_text()
    run(window, 4)
    status(window).filter(has_text='standing, cycle 7').wait_for()
    window.get_by_text('Motor current [A]: cycle 7', exact=True).wait_for()
    sync_api.expect(worst).not_to_have_text(before)
    window.wait_for_timeout(1000)  # of drawing
    ends = [(first, last) for title, first, last in window.evaluate(SHOWN) if title.endswith(': cycle 7')]
    assert len(ends) >= 4
    assert all(first < 1.0 < 300.0 < last for first, last in ends), 'the whole cycle [ms]'
    _picture(window, 'page')


def test_law_selected_in_the_list_runs(window):
    laws = window.get_by_label('law', exact=True)
    laws.fill('norm_optimal')
    laws.press('ArrowDown')
    laws.press('Enter')
    laws.blur()
    run(window, 2)
    notice(window, '^four_dof_70ms, law norm_optimal: done$')
    window.locator('td', has_text='four_dof_70ms, law norm_optimal').wait_for()


def _picture(window, name):
    """Make a picture of the page in the folder PKM_PICTURES, or a temporary one."""
    close = window.locator('#webgl-software-rendering button')
    if close.count():
        close.click()
    window.mouse.move(700, 850)
    window.wait_for_timeout(1500)
    with TemporaryDirectory() as folder:
        path = Path(os.environ.get('PKM_PICTURES') or folder) / f'{name}.png'
        window.screenshot(path=path)
        assert path.stat().st_size > 20_000, 'a blank page is smaller'


def test_cycle_chosen_from_the_history_is_shown(window):
    cycles = window.get_by_label('show cycle', exact=True)
    cycles.fill('2: ')
    window.get_by_role('option').filter(has_text=re.compile(r'^2: [\d.]+ um, four_dof_70ms, fourier_pid$')).wait_for()
    cycles.press('ArrowDown')
    cycles.press('Enter')
    cycles.blur()
    window.get_by_text('Error [um]: cycle 2', exact=True).wait_for()
    run(window, 1)
    notice(window, ': done$')
    window.get_by_text('Error [um]: cycle 10', exact=True).wait_for()


def test_scheme_follows_the_preference_of_the_browser(window, port):
    root = window.locator('html')
    sync_api.expect(root).to_have_attribute('data-mantine-color-scheme', 'light')
    window.emulate_media(color_scheme='dark')
    sync_api.expect(root).to_have_attribute('data-mantine-color-scheme', 'dark')
    status(window).wait_for()
    _picture(window, 'page_dark')
    window.emulate_media(color_scheme='light')
    sync_api.expect(root).to_have_attribute('data-mantine-color-scheme', 'light')
    status(window).wait_for()


def test_charts_are_within_the_width_of_a_phone(window):
    window.set_viewport_size(PHONE)
    chart = window.get_by_text(re.compile(r'^Error of the tool by laser \[um\]: cycle \d+$'))
    chart.scroll_into_view_if_needed()
    for place in (chart, status(window), window.get_by_role('button', name='Run', exact=True)):
        box = place.bounding_box()
        assert 0 <= box['x'] < box['x'] + box['width'] <= PHONE['width']
    window.set_viewport_size(WINDOW)
    status(window).wait_for()


def test_jog_ends_at_the_reach_and_visits_a_pose(window):
    inputs = window.locator('input.mantine-NumberInput-input')
    x = inputs.nth(inputs.count() - 4)  # of the sliders of x, y, z, phi
    type_into(window, x, '40')
    sync_api.expect(x).to_have_value('6')  # [mm] the links 6 and 8 end there
    type_into(window, x, '2')
    press(window, 'Visit')
    assert notice(window, 'visit: done') == 'visit: done'
    window.locator('td', has_text='poses, law none').wait_for()
    type_into(window, x, '0')


def test_cycle_of_a_fault_is_shown_and_reset(window):
    run(window, 900)
    notice(window, r'cycle \d+ of 900 done')
    press(window, 'Brake now')
    status(window).filter(has_text='fault').wait_for()
    number = re.search(r'\d+', status(window).inner_text())[0]
    shown = window.locator('[data-shown]')
    sync_api.expect(shown).to_have_text(re.compile(f'cycle {number}'))
    press(window, 'Reset after a fault')
    assert notice(window, '^reset').startswith('reset: at home')
    status(window).filter(has_text='standing').wait_for()


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
    window.locator('[data-command]').first.wait_for()
    turn_to(window, 'Nodes')
    window.locator('[data-nodes]').get_by_text('missing').first.wait_for()
    turn_to(window, 'Operate')
    press(window, 'Run')
    notice(window, 'no trajectory_generator offers execute_motion')
    cell.start()
    status(window).filter(has_text='standing').wait_for()
    sync_api.expect(window.locator('[data-command]')).to_have_count(0)
    assert window.get_by_text('Error [um]', exact=True).count() == 1, 'no curves of the former cell'
    run(window, 1)
    notice(window, ': done$')
    status(window).filter(has_text='standing, cycle 1').wait_for()
    window.get_by_text('Error [um]: cycle 1', exact=True).wait_for()


def test_bag_is_played_with_pause_and_scrub(window, module_processes):
    with socket.create_server(('127.0.0.1', 0)) as probe:
        port = probe.getsockname()[1]
    bags = module_processes.folder / 'bags'
    player = module_processes.start(BIN / 'pkm', 'page', '--bag', bags, '--port', port, log='player.log')
    try:
        _open(window, f'http://127.0.0.1:{port}')
        status(window).filter(has_text=re.compile(r'bag, cycle \d+, [\d.]+ ms, paused$')).wait_for()  # it has ended
        type_into(window, window.locator('input.mantine-NumberInput-input').first, '30')
        status(window).filter(has_text=re.compile(', 30.0 ms, paused$')).wait_for()
        window.locator('[data-now]').wait_for()
        press(window, '+1')
        status(window).filter(has_text=re.compile(', 30.5 ms, paused$')).wait_for()
        press(window, 'Play')
        status(window).filter(has_not_text='30.5 ms').wait_for()
    finally:
        module_processes.stop(player)


def test_port_in_use_is_refused_with_one_line(window, module_processes, port):
    refused = module_processes.run(BIN / 'pkm', 'page', '--port', port)
    assert refused.returncode == 1
    assert refused.stdout == ''
    expected = (
        f'pkm: page: cannot listen on 127.0.0.1 port {port}: Address already in use; choose another with --port\n'
    )
    assert refused.stderr == expected
