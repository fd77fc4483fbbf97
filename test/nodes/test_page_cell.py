"""The state of a cell on the page: figures, history and curves of one bag each; without a graph."""

import math

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from pkm_core.bag.writer import BagWriter
from pkm_core.errors import BagError
from pkm_core.machines.description import joint_positions
from pkm_interfaces.msg import CycleEvent, CycleMetrics, LaserSample, MotorCommand, SampledTrajectory
from pkm_nodes.page.cell import Cell, NodeLine, Status
from pkm_nodes.page.panels import history_html, learned_html, nodes_html, notice_html, shown_html, status_html
from pkm_nodes.page.trace import Trace, read_trace


@pytest.fixture
def cell(machine):
    return Cell(machine)


def record(folder, joints, errors, voltages, *, name='bag', laser=(), poses=None):
    """Write a bag of one cycle; errors and voltages are (N, n), laser rows (time, displacement), poses (M, m)."""
    topics = {f'/pkm/{joint}/command': 'pkm_interfaces/msg/MotorCommand' for joint in joints}
    others = {'/pkm/laser': 'LaserSample', '/pkm/pose_trajectory': 'SampledTrajectory'}
    kinds = {topic: f'pkm_interfaces/msg/{kind}' for topic, kind in others.items()}
    bag = BagWriter(folder / name, {**topics, **kinds}, {})
    if poses is not None:
        plan = dict.fromkeys(('position', 'velocity', 'acceleration', 'jerk'), np.ravel(poses).tolist())
        plan |= {'coordinates': ['x', 'y', 'z', 'phi'], 'motion': 'short', 'learning_law': 'fourier'}
        plan |= {'move_starts': [1], 'move_ends': [2], 'feedforward': [0.0]}
        bag.write('/pkm/pose_trajectory', serialize_message(SampledTrajectory(**plan)), 0)
    for time, *displacement in laser:
        bag.write('/pkm/laser', serialize_message(LaserSample(time=time, displacement=displacement)), 0)
    for tick, (error, voltage) in enumerate(zip(errors, voltages, strict=True), start=100):
        for topic, e, v in zip(topics, error, voltage, strict=True):
            bag.write(
                topic, serialize_message(MotorCommand(tick=tick, cycle=1, error=e, voltage=v, feedforward=v / 2)), tick
            )
    bag.close({})
    return folder / name


def measure(cell, cycle, *errors):
    for joint, error in zip(cell.machine.joints, errors, strict=True):
        cell.measure(CycleMetrics(cycle=cycle, joint=joint, max_dynamic_error=error))


def test_best_cycle_has_the_least_worst_axis_error(cell):
    measure(cell, 1, 9e-6, 1e-6, 1e-6, 1e-6)
    assert (cell.best_cycle, cell.worst(1)) == (1, 9e-6)
    cell.measure(CycleMetrics(cycle=2, joint='d1', max_dynamic_error=1e-9))
    assert math.isnan(cell.worst(2))
    assert cell.best_cycle == 1, 'not all axes of cycle 2 are known'
    measure(cell, 2, 2e-6, 3e-6, 2e-6, 2e-6)
    measure(cell, 3, 4e-6, 1e-6, 1e-6, 1e-6)
    assert (cell.best_cycle, cell.worst(2)) == (2, 3e-6)


def test_best_cycle_is_kept_when_old_cycles_are_dropped(cell):
    for cycle in range(1, 700):
        measure(cell, cycle, *4 * [1e-6 if cycle == 3 else 2e-6])
    assert len(cell.errors) == 500
    assert cell.worst(cell.best_cycle) == 1e-6


@pytest.mark.parametrize(
    ('motion', 'law', 'scale', 'kept'),
    [
        ('short', 'fourier', 1.0, True),
        ('short', 'none', 1.0, False),
        ('other', 'fourier', 1.0, False),
        ('short', 'fourier', 1.1, False),
    ],
)
def test_errors_are_dropped_when_motion_or_law_changes(cell, motion, law, scale, kept):
    poses = np.tile(cell.machine.forward(cell.machine.home), (5, 1))
    cell.load(1, 'short', 'fourier', poses)
    measure(cell, 1, *4 * [1e-6])
    measure(cell, 2, *4 * [2e-6])  # came before the trajectory it belongs to
    cell.load(2, motion, law, scale * poses)
    assert list(cell.errors) == ([1, 2] if kept else [2])
    assert cell.best_cycle == (1 if kept else 2)
    assert cell.path == pytest.approx(scale * poses[:, :3])


def test_status_follows_the_cycle_events(cell, machine):
    story = [
        (CycleEvent.STARTED, Status.RUNNING, ''),
        (CycleEvent.FAULT, Status.FAULT, 'd1 has hit its stop'),
        (CycleEvent.RESET, Status.STANDING, ''),
        (CycleEvent.STARTED, Status.RUNNING, ''),
        (CycleEvent.FINISHED, Status.STANDING, ''),
    ]
    for cycle, (event, status, reason) in enumerate(story, start=1):
        cell.positions = {}
        cell.hear(CycleEvent(event=event, cycle=cycle, message='d1 has hit its stop'))
        assert (cell.status, cell.reason) == (status, reason)
        if event == CycleEvent.RESET:
            assert cell.positions == joint_positions(machine, machine.home)


def test_cycle_without_a_bag_shows_why(cell):
    cell.hear(CycleEvent(event=CycleEvent.NOT_RECORDED, cycle=3, message='/bags: No space left on device'))
    assert 'cycle 3 is not recorded: /bags: No space left on device' in shown_html(cell)


def test_trace_holds_the_commands_of_the_bag(cell, tmp_path):
    random = np.random.default_rng(1)
    errors, voltages = random.normal(size=(2, 30, 4)).tolist()
    bag = record(tmp_path, cell.machine.joints, errors, voltages)
    trace = read_trace(bag, 7, cell.machine, '/pkm')
    assert trace.cycle == 7
    assert np.array_equal(trace.error, errors)
    assert np.array_equal(trace.voltage, voltages)
    assert np.array_equal(trace.feedforward, np.array(voltages) / 2)
    assert (trace.tool, trace.samples) == (None, 0), 'no plan in the bag'


def test_tool_error_is_the_laser_against_the_planned_poses(cell, tmp_path):
    """The tool goes 2 um too far in x and 40 urad in phi, from the first move on."""
    samples, first = 60, 100
    poses = np.zeros((samples, 4)) + cell.machine.forward(cell.machine.home)
    poses[20:, 0] += 1e-9  # the start of the move
    time = np.arange(first * 5e-4, (first + samples) * 5e-4, 8e-4)
    moved = time >= (first + 20) * 5e-4
    rows = [[t, 5e-6 + m * 2e-6, 5e-6, 5e-6, m * 4e-5] for t, m in zip(time.tolist(), moved.tolist(), strict=True)]
    zeros = np.zeros((samples, 4)).tolist()
    bag = record(tmp_path, cell.machine.joints, zeros, zeros, laser=rows, poses=poses)
    cell.hear(CycleEvent(event=CycleEvent.RECORDED, cycle=1, bag=str(bag)))
    cell.refresh()
    tool = cell.shown.tool
    assert tool.cycle == 1
    assert tool.time[-1] == pytest.approx((time - time[0])[-1])
    assert 1e6 * tool.error[-1] == pytest.approx([-2.0, 0.0, 0.0, -2.0], abs=2e-3)
    assert '<span data-tool>x 2.0, y 0.0, z 0.0, phi 2.0</span> um' in status_html(cell)


def test_cycle_chosen_from_the_history_stays_shown(cell, tmp_path):
    zeros = np.zeros((3, 4)).tolist()
    for cycle in (1, 2):
        bag = record(tmp_path, cell.machine.joints, zeros, zeros, name=f'bag{cycle}')
        cell.hear(CycleEvent(event=CycleEvent.STARTED, cycle=cycle))
        cell.hear(CycleEvent(event=CycleEvent.RECORDED, cycle=cycle, bag=str(bag)))
        measure(cell, cycle, *4 * [cycle * 1e-6])
        cell.chosen = 1
        cell.refresh()
        assert cell.shown.cycle == 1
    assert [past.line for past in cell.history] == ['2: 2.00 um, , ', '1: 1.00 um, , ']
    cell.chosen = 0
    cell.refresh()
    assert cell.shown.cycle == 2


def test_cycle_of_a_fault_is_shown_with_its_curves(cell, tmp_path):
    poses = np.tile(cell.machine.forward(cell.machine.home), (8, 1))
    rows = np.ones((3, 4)).tolist()
    bag = record(tmp_path, cell.machine.joints, rows, rows, poses=poses)
    cell.hear(CycleEvent(event=CycleEvent.STARTED, cycle=1))
    cell.hear(CycleEvent(event=CycleEvent.FAULT, cycle=1, message='d1 has hit its stop'))
    cell.hear(CycleEvent(event=CycleEvent.RECORDED, cycle=1, bag=str(bag)))
    cell.refresh()
    assert len(cell.shown.error) == 3
    html = shown_html(cell)
    assert 'fault: d1 has hit its stop' in html
    assert 'curves until the stop, 1.5 of 4.0 ms' in html
    assert next(iter(cell.history)).line.startswith('1: fault')


def test_nothing_of_the_former_cell_stays_after_a_restart(cell, tmp_path):
    zeros = np.zeros((3, 4)).tolist()
    bag = record(tmp_path, cell.machine.joints, zeros, zeros)
    cell.load(1, 'short', 'fourier', np.tile(cell.machine.forward(cell.machine.home), (3, 1)))
    cell.hear(CycleEvent(event=CycleEvent.RECORDED, cycle=1, bag=str(bag)))
    measure(cell, 1, *4 * [1e-6])
    cell.refresh()
    cell.begin_anew()
    cell.refresh()
    assert (cell.shown, cell.best, cell.path, cell.errors, len(cell.history)) == (None, None, None, {}, 0)
    assert (cell.motion, cell.law, cell.best_cycle) == ('', '', 0)


@pytest.mark.parametrize('bag_first', [True, False])
def test_best_trace_is_that_of_the_best_cycle(cell, tmp_path, bag_first):
    zeros = np.zeros((3, 4)).tolist()
    for cycle, error in ((1, 5e-6), (2, 1e-6), (3, 2e-6)):
        bag = record(tmp_path, cell.machine.joints, zeros, zeros, name=f'bag{cycle}')
        event = CycleEvent(event=CycleEvent.RECORDED, cycle=cycle, bag=str(bag))
        steps = [lambda event=event: cell.hear(event), lambda c=cycle, e=error: measure(cell, c, *4 * [e])]
        for step in steps if bag_first else reversed(steps):
            step()
        cell.refresh()
    assert (cell.best.cycle, cell.shown.cycle) == (2, 3)


def test_missing_bag_is_reported_without_curves(cell, tmp_path):
    zeros = np.zeros((3, 4)).tolist()
    bag = record(tmp_path, cell.machine.joints, zeros, zeros)
    cell.hear(CycleEvent(event=CycleEvent.RECORDED, cycle=1, bag=str(bag)))
    cell.refresh()
    assert cell.shown.cycle == 1
    cell.hear(CycleEvent(event=CycleEvent.RECORDED, cycle=2, bag=str(tmp_path / 'elsewhere')))
    cell.refresh()
    assert cell.shown is None, 'not the curves of another cycle'
    assert cell.no_trace == f'{tmp_path / "elsewhere"}: no such bag on this computer'


def test_bag_of_another_cell_is_refused(cell, tmp_path):
    bag = record(tmp_path, ('x', 'y'), np.zeros((3, 2)).tolist(), np.zeros((3, 2)).tolist())
    with pytest.raises(BagError, match=r'has no tick with a command of every joint of \[.d1'):
        read_trace(bag, 1, cell.machine, '/pkm')
    (next(bag.glob('*.mcap'))).write_bytes(b'\x89MCAP0\r\nnonsense')
    with pytest.raises(BagError, match='cannot be read as a bag'):
        read_trace(bag, 1, cell.machine, '/pkm')


def test_text_from_the_graph_is_escaped(cell):
    cell.hear(CycleEvent(event=CycleEvent.FAULT, message='<script>'))
    cell.hear(CycleEvent(event=CycleEvent.REFUSED, source='<b>', message='<i>'))
    cell.motion = cell.law = cell.geometry = '<u>'
    cell.history.note(1, motion='<u>', law='<i>', fault='<b>')
    cell.nodes = [NodeLine('<b>', good=True, text='<i>')]
    cell.shown = Trace(1, '<u>', '<b>', 5, *3 * [np.zeros((2, 4))])
    for make in (status_html, notice_html, nodes_html, shown_html, learned_html, history_html):
        html = make(cell).replace('<b data-worst>', '').replace(f'<b>cycle {cell.shown.cycle}</b>', '')
        assert not any(tag in html for tag in ('<script>', '<b>', '<i>', '<u>'))
