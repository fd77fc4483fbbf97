"""Parts of the page without ROS: hints, colours of the state, reach of the sliders, lengths in use, bounded texts."""

import numpy as np
import pytest

from pkm_core.errors import WorkspaceError
from pkm_core.machines import load_machine
from pkm_core.machines.geometry import load_geometry
from pkm_nodes.page.cell import Cell, Pace, Status
from pkm_nodes.page.controls import JogControls, PaceControls, RunControls, reaches
from pkm_nodes.page.history import MEMORY, History
from pkm_nodes.page.lengths import Lengths
from pkm_nodes.page.page import Page
from pkm_nodes.page.panels import status_html

BUILT = """
built:
  specimen: {machine: planar, origin: simulated, seed: 1, environment: nominal}
  l2: 70.013 mm
  l4: 69.991 mm
  dy: 10.004 mm
  marks: {d1: 0.002 mm, d3: -0.001 mm}
"""


@pytest.fixture(scope='module')
def gui():
    """Return the GUI of a real server without a browser."""
    page = Page('127.0.0.1', 0)
    yield page._server.gui
    page.close()


def test_page_without_a_cell_shows_how_to_start_one():
    html = status_html(Cell(namespace='/left', domain=7))
    assert 'waiting for a cell in /left' in html
    assert 'ROS_DOMAIN_ID=7 bringup_scripts/ros2 run pkm_nodes cell --ros-args -r __ns:=/left</code>' in html
    assert html.count('<button onclick="navigator.clipboard') == 3


def test_played_messages_are_named_instead_of_a_missing_cell(machine):
    html = status_html(Cell(machine, is_replayed=True))
    assert 'pkm bag-play publishes here' in html
    assert 'run pkm_nodes cell' not in html


@pytest.mark.parametrize('name', ['four_dof', 'planar', 'xy_stage'])
def test_ends_of_every_slider_are_the_reach_there(name):
    """A step of the slider beyond an end is refused; the end itself is not."""
    machine = load_machine(name)
    home = machine.forward(machine.home)
    offsets = dict.fromkeys(machine.coordinates, 0.0) | {'x': 2e-3}
    pose = home + np.array(list(offsets.values()))
    for index, (coordinate, ends) in enumerate(reaches(machine, offsets).items()):
        scale = np.radians(1.0) if coordinate == 'phi' else 1e-3
        for end, outwards in zip(ends, (-0.2, 0.2), strict=True):
            at = pose.copy()
            at[index] = home[index] + scale * end
            machine.check_pose(at)
            at[index] += scale * outwards
            with pytest.raises(WorkspaceError):
                machine.check_pose(at)


def test_number_typed_beyond_the_reach_becomes_the_reach(gui, machine):
    aims = []
    jog = JogControls(gui, machine, lambda *_: None, aims.append)
    slider = jog._sliders['x']
    end = slider.max
    slider.value = 40.0
    jog._on_change(slider)
    assert (slider.value, slider.max) == (end, end)
    assert aims == [jog.offsets()]
    assert aims[0]['x'] == pytest.approx(1e-3 * end)


def test_buttons_are_coloured_by_the_state(gui, machine):
    controls, cell = RunControls(gui, machine, lambda *_: None), Cell(machine)
    found = {}
    for status in (Status.AWAY, Status.STANDING, Status.RUNNING, Status.FAULT):
        cell.status = status
        controls.show(cell)
        found[status] = [controls._buttons[name].color for name in ('run', 'stop', 'brake', 'reset')]
    assert found == {
        Status.AWAY: ['gray', 'gray', 'gray', 'gray'],
        Status.STANDING: ['green', 'gray', 'gray', 'gray'],
        Status.RUNNING: ['gray', 'orange', 'red', 'gray'],
        Status.FAULT: ['gray', 'gray', 'gray', 'red'],
    }


def test_pace_is_hidden_unless_the_machine_offers_it(gui, machine):
    controls, cell = PaceControls(gui, lambda *_: None), Cell(machine)
    controls.show(cell)
    assert not controls._folder.visible
    cell.pace = Pace(offered=True, asked=0.5, reached=0.4987, paused=True)
    controls.show(cell)
    assert controls._folder.visible
    assert controls._slider.value == 0.5
    assert controls._pause.label == 'Continue'
    assert 'asked: 0.5 x real time; reached: 0.499' in controls._text.content
    assert ', paused' in status_html(cell)


def test_history_keeps_the_newest_cycles():
    history = History()
    for cycle in range(1, MEMORY + 50):
        history.note(cycle, motion='m', law='l' * 1000)
    lines = [past.line for past in history]
    assert len(lines) == len(history) == MEMORY
    assert lines[0].startswith(f'{MEMORY + 49}: no figures')
    assert max(map(len, lines)) < 100


def test_long_texts_of_the_graph_are_cut(machine):
    cell = Cell(machine, status=Status.FAULT, reason='<' * 100_000)
    assert len(status_html(cell)) < 4000


def test_calibrated_lengths_are_drawn_and_named(tmp_path):
    """A file that is missing, or has other numbers than announced, changes nothing but the words."""
    lengths, drawn = Lengths('planar'), load_geometry('planar')
    assert lengths.words == f'as drawn, hash {drawn.digest}'
    start, file = lengths.machine, tmp_path / 'planar.yaml'
    file.write_text(drawn.text + BUILT)
    built = drawn.exchanged(file.name, file.read_text())
    lengths.announce(str(tmp_path / 'missing.yaml'), built.digest)
    assert lengths.machine is start
    assert 'cannot be read here: No such file or directory; shown are those of the start' in lengths.words
    lengths.announce(str(file), 12 * 'a')
    assert lengths.machine is start
    assert f'has hash {built.digest}; the cell uses aaaaaaaaaaaa' in lengths.words
    lengths.announce(str(file), built.digest)
    assert lengths.machine.config.built.l2 == 70.013e-3
    assert lengths.words == f'calibrated, planar.yaml, hash {built.digest}'
    lengths.announce('planar', drawn.digest)
    assert lengths.machine is start
