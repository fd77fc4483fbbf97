"""
How much the live page slows a composed cell at full speed: with and without it, in turns.

Run `.venv/bin/python test/bench/bench_page.py`. The viewer stands for a browser on another computer: it takes all the
page sends. `--browser` puts headless Chromium on this one instead, which draws in software on the cell's own cores.
Ticks/s mean something on a machine that does nothing else; the processor time the cell needs for a tick always does.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from statistics import median
from time import monotonic, sleep
from urllib.request import urlopen

BIN = Path(sys.prefix) / 'bin'
PORT = 8477
VIEWER = f"""
import signal, sys, viser
from websockets.sync.client import connect
signal.signal(signal.SIGINT, lambda *_: sys.exit())
with connect('ws://127.0.0.1:{PORT}', subprotocols=[f'viser-v{{viser.__version__}}'], max_size=None,
             open_timeout=60) as socket:
    for message in socket:
        pass
"""


@contextmanager
def process(*command):
    """Run a program for the duration of the block."""
    started = subprocess.Popen([str(word) for word in command], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        yield started
    finally:
        started.send_signal(signal.SIGINT)
        started.wait(20)


@contextmanager
def chromium():
    """Show the page in headless Chromium."""
    from playwright.sync_api import sync_playwright

    flags = ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader']
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path='/usr/bin/chromium', args=flags)
        window = browser.new_page(viewport={'width': 1200, 'height': 900})
        window.goto(f'http://127.0.0.1:{PORT}')
        window.wait_for_selector('[data-status]', timeout=60_000)
        yield
        browser.close()


def wait_for_page():
    """Wait until the page listens and has found the cell."""
    deadline = monotonic() + 60
    while monotonic() < deadline:
        with suppress(OSError), urlopen(f'http://127.0.0.1:{PORT}', timeout=10):
            break
        sleep(0.2)
    sleep(3)


def processor_time(pid):
    """Return the processor time [s] a process has had."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def main():
    """Print both figures of every turn and the medians of their ratios."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('--turns', type=int, default=8)
    options.add_argument('--cycles', type=int, default=6, help='a turn')
    options.add_argument('--browser', action='store_true')
    options = options.parse_args()
    os.environ |= {'ROS_DOMAIN_ID': '83', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    from pkm_nodes.client import CellClient
    from pkm_nodes.processes import CellProcesses

    with (
        tempfile.TemporaryDirectory() as folder,
        CellProcesses('four_dof', 'composed', seed=1, environment='nominal', folder=folder) as cell,
        CellClient() as client,
    ):
        client.wait_until_up(cell.check)
        pid = cell.processes['cell'].pid

        def turn():
            """Return ticks/s and the cell's processor time a tick [us]."""
            before = processor_time(pid)
            log = client.execute('four_dof_70ms', options.cycles, 'fourier_pid', cell.check, lambda _: None)
            ticks, seconds = log.ticks, log.seconds_in_cycles
            log.ticks, log.seconds_in_cycles = 0, 0.0
            log.bags.clear()
            return ticks / seconds, 1e6 * (processor_time(pid) - before) / ticks

        def turn_with_page():
            with ExitStack() as stack:
                page = stack.enter_context(process(BIN / 'pkm', 'page', '--port', PORT))
                wait_for_page()
                stack.enter_context(chromium() if options.browser else process(sys.executable, '-c', VIEWER))
                sleep(2)
                before, since = processor_time(page.pid), monotonic()
                figures = turn()
                shares.append((processor_time(page.pid) - before) / (monotonic() - since))
                return figures

        turn()  # warm
        ratios, shares = [], []
        for number in range(options.turns):
            pair = {}
            for name in ('without', 'with') if number % 2 else ('with', 'without'):
                pair[name] = turn() if name == 'without' else turn_with_page()
            ratios.append([a / b for a, b in zip(pair['with'], pair['without'], strict=True)])
            print(
                f'without: {pair["without"][0]:5.0f} ticks/s, {pair["without"][1]:4.0f} us a tick; '
                f'with: {pair["with"][0]:5.0f} ticks/s, {pair["with"][1]:4.0f} us a tick; '
                f'ratios {ratios[-1][0]:.3f}, {ratios[-1][1]:.3f}; page: {100 * shares[-1]:.0f} % of a core',
                flush=True,
            )
        speed, time = (median(column) for column in zip(*ratios, strict=True))
        print(f'medians: ticks/s x {speed:.3f}, processor time a tick x {time:.3f}, page {100 * median(shares):.0f} %')


if __name__ == '__main__':
    main()
