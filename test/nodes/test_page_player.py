"""Played bags on the page: pace, pause, scrub, choice of the cycle; bags that are damaged or of no cell."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from pkm_core.bag.writer import BagWriter
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_interfaces.msg import CycleMetrics, EncoderSample, MotorCommand, SampledTrajectory
from pkm_nodes.page.cell import Status
from pkm_nodes.page.panels import shown_html, status_html
from pkm_nodes.page.player import Player

TICKS, TICK = 101, 0.5e-3  # 50 ms
MACHINE = load_machine('planar')


def record(folder, cycle, error, *, ticks=TICKS, motion='short', **facts):
    """Write a bag of `cycle`: the joints move by 1 mm with a constant `error` [m]."""
    way = np.linspace(0.0, 1e-3, TICKS)[:, np.newaxis]
    joints, kinds = MACHINE.home + way, {'encoder': 'EncoderSample', 'command': 'MotorCommand'}
    kinds |= {'cycle_metrics': 'CycleMetrics'}
    topics = {f'/pkm/{j}/{name}': f'pkm_interfaces/msg/{k}' for j in MACHINE.joints for name, k in kinds.items()}
    topics |= {f'/pkm/{name}_trajectory': 'pkm_interfaces/msg/SampledTrajectory' for name in ('joint', 'pose')}
    facts = {'machine': 'planar', 'motion': motion, 'learning_law': 'fourier', 'cycle': str(cycle), **facts}
    bag = BagWriter(folder / f'{motion}_{cycle:04d}', topics, facts)
    plans = {'joint': (MACHINE.joints, joints), 'pose': (MACHINE.coordinates, MACHINE.forward(joints))}
    for name, (columns, rows) in plans.items():
        plan = dict.fromkeys(('position', 'velocity', 'acceleration', 'jerk'), rows.ravel().tolist())
        plan |= {'cycle': cycle, 'motion': motion, 'learning_law': 'fourier', 'sample_time': TICK}
        plan |= {'coordinates': list(columns), 'move_starts': [10], 'move_ends': [60], 'feedforward': [0.0]}
        bag.write(f'/pkm/{name}_trajectory', serialize_message(SampledTrajectory(**plan)), 0)
    for tick in range(ticks):
        for joint, position in zip(MACHINE.joints, joints[tick] - error, strict=True):
            sample = EncoderSample(tick=tick, cycle=cycle, index=tick, position=position)
            bag.write(f'/pkm/{joint}/encoder', serialize_message(sample), tick)
            bag.write(f'/pkm/{joint}/command', serialize_message(MotorCommand(tick=tick, error=error)), tick)
    for joint in MACHINE.joints:
        metrics = CycleMetrics(cycle=cycle, joint=joint, max_dynamic_error=error)
        bag.write(f'/pkm/{joint}/cycle_metrics', serialize_message(metrics), ticks)
    bag.close({'end': 'finished' if ticks == TICKS else 'fault: d1 has hit its stop'})
    return bag.path


class Clock:
    """Wall time that a test sets."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def player(tmp_path, clock):
    """Return a player of three cycles; the last ends in a fault after 40 ticks."""
    for cycle, error, ticks in ((1, 5e-6, TICKS), (2, 1e-6, TICKS), (3, 9e-6, 40)):
        record(tmp_path / 'bags', cycle, error, ticks=ticks)
    player = Player(tmp_path, clock)
    for _ in range(3):
        player.advance()
    player.fulfil(('show', 2))
    return player


def test_played_bag_moves_the_machine_at_its_pace(player, clock):
    for pace, wall in ((1.0, 10e-3), (0.1, 100e-3), (3.0, 10e-3 / 3.0)):
        player.fulfil(('show', 2))
        player.fulfil(('pace', pace))
        player.advance()
        clock.now += wall
        player.advance()
        assert player.time == pytest.approx(10e-3)
        expected = MACHINE.home[0] + 1e-3 * 20 / 100 - 1e-6
        assert player.cell.positions['d1'] == pytest.approx(expected)
        assert player.cell.pose['x'] == pytest.approx(MACHINE.forward(MACHINE.home + 1e-3 * 20 / 100 - 1e-6)[0])


def test_pause_and_scrub_show_every_instant(player, clock):
    player.fulfil(('seek', 30e-3))
    clock.now += 5.0
    player.advance()
    assert (player.time, player.is_playing) == (30e-3, False)
    assert player.error == pytest.approx({'d1': 1e-6, 'd3': 1e-6})
    assert 'bag, cycle 2, 30.0 ms, paused' in status_html(player.cell)
    player.fulfil(('tick', -1))
    player.advance()
    assert player.time == pytest.approx(29.5e-3)
    for beyond, end in ((9.0, 50e-3), (-9.0, 0.0)):
        player.fulfil(('seek', beyond))
        assert player.time == end


def test_player_stops_at_the_end_and_plays_again_from_the_start(player, clock):
    player.advance()
    clock.now += 1.0
    player.advance()
    assert (player.time, player.is_playing) == (50e-3, False)
    player.fulfil(('play',))
    assert (player.time, player.is_playing) == (0.0, True)


def test_played_cycles_are_compared_and_the_fault_is_shown(player):
    cell = player.cell
    assert (cell.status, cell.best_cycle, sorted(cell.errors)) == (Status.PLAYED, 2, [1, 2, 3])
    assert [past.line.split(',')[0] for past in cell.history] == ['3: fault', '2: 1.00 um', '1: 5.00 um']
    player.fulfil(('show', 3))
    assert cell.shown.cycle == 3
    assert 'curves until the stop, 20.0 of 50.5 ms' in shown_html(cell)
    assert player.duration == pytest.approx(19.5e-3)


def test_cycles_of_another_motion_are_not_compared(tmp_path, clock):
    record(tmp_path, 1, 5e-6)
    record(tmp_path, 2, 1e-6, motion='other')
    player = Player(tmp_path, clock)
    player.advance()
    assert (player.cell.motion, list(player.cell.errors)) == ('other', [2])
    player.fulfil(('show', 1))
    assert (player.cell.motion, list(player.cell.errors)) == ('short', [1])


def test_damaged_bag_of_a_run_is_named_and_the_others_play(player, tmp_path):
    file = next((tmp_path / 'bags' / 'short_0001').glob('*.mcap'))
    file.write_bytes(b'\x89MCAP0\r\nnonsense')
    again = Player(tmp_path)
    for _ in range(3):
        again.advance()
    again.fulfil(('show', 1))
    again.advance()
    assert 'cannot be read as a bag' in shown_html(again.cell)
    assert again.cell.shown is None
    again.fulfil(('show', 2))
    assert again.cell.shown.cycle == 2


@pytest.mark.parametrize(
    ('facts', 'message'),
    [({'machine': ''}, 'does not name its machine'), ({'machine': 'lathe'}, 'lathe')],
)
def test_bag_of_an_unknown_machine_is_refused(tmp_path, facts, message):
    record(tmp_path, 1, 1e-6, **facts)
    with pytest.raises(PkmError, match=message):
        Player(tmp_path)


def test_folder_without_a_bag_is_refused(tmp_path):
    with pytest.raises(PkmError, match='has no bag; expected a bag, or a folder of bags'):
        Player(tmp_path)
    with pytest.raises(PkmError, match='no such bag or folder'):
        Player(tmp_path / 'nowhere')
