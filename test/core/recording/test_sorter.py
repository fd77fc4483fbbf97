"""The sorter: serialized messages in, each in the bag of its cycle."""

import struct

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.message_types import typestore
from pkm_core.bag.reader import raw_messages
from pkm_core.recording.recording import Recording
from pkm_core.recording.topics import recorded_topics
from support.recorded_cell import JOINTS, MACHINE, SAMPLES, Cell


def test_one_block_of_two_cycles_is_divided(slow_cell):
    slow_cell.load(1)
    slow_cell.run(1, 40, end=10)
    slow_cell.arrive()
    for index in range(10, SAMPLES):
        slow_cell.tick(1, 40 + index, index)
    slow_cell.finish(1, 40 + SAMPLES)
    slow_cell.play(2, 40 + SAMPLES, feedforward=lambda index: 0.1 * index)
    slow_cell.arrive()
    assert slow_cell.recording.progress == 40 + 2 * SAMPLES - 1
    outcomes = slow_cell.recording.outcomes
    assert [(o.cycle, o.failure, o.lost) for o in outcomes] == [(1, '', {}), (2, '', {})]
    for number, outcome in enumerate(outcomes):
        first = 40 + number * SAMPLES
        assert read_cycle(outcome.path).ticks.tolist() == list(range(first, first + SAMPLES))
        for topic, _, data, time in raw_messages(outcome.path):
            if topic.endswith(('encoder', 'command')):
                assert time == struct.unpack_from('<Q', data, 4)[0] * 500_000
    assert read_cycle(outcomes[1].path).feedforward[:, 2].tolist() == [0.1 * index for index in range(SAMPLES)]
    assert slow_cell.warnings == []


def test_late_block_warns_per_message_and_is_dropped(slow_cell):
    slow_cell.play(1, 0)
    slow_cell.arrive()
    for tick in range(3):
        slow_cell.tick(1, SAMPLES - 3 + tick, 0)
    slow_cell.play(2, SAMPLES)
    slow_cell.arrive()
    late = [text for text in slow_cell.warnings if 'of cycle 1 arrived after its bag was closed' in text]
    assert len(late) == 3 * 2 * len(JOINTS)
    assert [(o.cycle, o.lost) for o in slow_cell.recording.outcomes] == [(1, {}), (2, {})]
    assert read_cycle(slow_cell.recording.outcomes[1].path).is_whole


def test_late_message_is_warned_of(cell):
    cell.play(1, 0)
    cell.outcome()
    cell.tick(1, 5, 5, without=[f'{joint}/{kind}' for joint in JOINTS for kind in ('encoder', 'command')][1:])
    cell.recording.sort()
    assert cell.warnings == ['/pkm/d1/encoder: a message of cycle 1 arrived after its bag was closed; not recorded']


def test_states_at_standstill_are_in_no_bag(cell):
    """Their stamp is half a tick from the ticks around it; they may arrive before, during and after a cycle."""
    cell.states(0.5)  # power-up
    cell.load(1)
    cell.states(0.5)
    cell.run(1, 0)
    cell.states(SAMPLES - 0.5)
    cell.finish(1, SAMPLES)
    for _ in range(3):
        cell.states(SAMPLES - 0.5)
    cell.play(2, SAMPLES)
    assert [(each.lost, each.surplus) for each in cell.recording.outcomes] == [({}, {}), ({}, {})]
    for number, outcome in enumerate(cell.recording.outcomes):
        ticks = [tick for tick in range(number * SAMPLES, (number + 1) * SAMPLES) if tick % 20 == 0]
        found = [time for topic, _, _, time in raw_messages(outcome.path) if topic == '/pkm/pose']
        assert found == [500_000 * tick for tick in ticks]
    assert cell.warnings == []


def test_message_without_tick_goes_into_running_cycle(tmp_path):
    topics = recorded_topics(JOINTS)
    cell = Cell(tmp_path)
    diagnostics = next(topic for topic in topics if topic.name == '/diagnostics')
    cell.recording = Recording(
        tmp_path,
        cell.topics | {'/diagnostics': diagnostics},
        MACHINE,
        1.0,
        lambda *_: {},
        cell.warnings.append,
        lambda topic: True,
    )
    take, types = cell.recording.takers['/diagnostics'], typestore()
    of_node = {}
    for name in ('/pkm/machine', '/pkm_2/machine', '/left/pkm/machine'):
        fields = {'level': 0, 'message': '', 'hardware_id': '', 'values': []}
        status = types.types['diagnostic_msgs/msg/DiagnosticStatus'](name=name, **fields)
        header = types.types['std_msgs/msg/Header'](types.types['builtin_interfaces/msg/Time'](0, 0), '')
        array = types.types[diagnostics.kind](header=header, status=[status])
        of_node[name] = bytes(types.serialize_cdr(array, diagnostics.kind))
    take(of_node['/pkm/machine'])  # while nothing runs
    cell.load(1)
    cell.run(1, 0, end=10)
    for data in of_node.values():  # the last two are of other cells in the same graph
        take(data)
    cell.recording.close_all()
    [(topic, _, data, time)] = raw_messages(cell.outcome().path, ['/diagnostics'])
    assert (topic, bytes(data), time) == ('/diagnostics', of_node['/pkm/machine'], 9 * 500_000)
