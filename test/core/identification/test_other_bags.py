"""Bags of other people's axes: odd messages and clocks are skipped, counted, or refused with numbers; K and a hold."""

import json
from functools import cache

import numpy as np
import pytest
import typer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner

from pkm_core.bag.message_types import typestore
from pkm_core.bag.signals import Signal
from pkm_core.errors import BagError
from pkm_core.identification import IdentificationError
from pkm_core.identification.bag_data import read_axis
from pkm_core.verbs.identify_bag import identify_bag

GAIN, VISCOSITY = 12.0, 6.0  # rad/s^2 per N m, 1/s
STEP, COUNT = 2_000_000, 2000  # [ns], samples
BEGIN = 1_790_000_000 * 10**9  # [ns]
TORQUE, ANGLE = Signal('/joint_states', 'effort[elbow]'), Signal('/joint_states', 'position[elbow]')
OPTIONS = [
    *('--input-topic', '/joint_states', '--input-field', 'effort[elbow]'),
    *('--output-topic', '/joint_states', '--output-field', 'position[elbow]'),
]


@cache
def axis():
    """Return torque [N m], held over each sample, and angle [rad] of an axis that moves to and fro."""
    time = 1e-9 * STEP * np.arange(COUNT)
    torque = np.sign(np.sin(2 * np.pi * time / 0.8)) * np.sin(2 * np.pi * time / 0.4) ** 2
    decay = np.exp(-VISCOSITY * 1e-9 * STEP)
    angle, speed, angles = 0.0, 0.0, np.zeros(COUNT)
    for k in range(COUNT):
        angles[k] = angle
        final = GAIN * torque[k] / VISCOSITY
        angle += final * 1e-9 * STEP + (speed - final) * (1 - decay) / VISCOSITY
        speed = final + (speed - final) * decay
    return torque, angles


def state(stamp, names=('elbow',), position=(), effort=()):
    """Return a serialized JointState with the `stamp` [ns]."""
    store = typestore()
    types = store.types
    header = types['std_msgs/msg/Header'](
        stamp=types['builtin_interfaces/msg/Time'](sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=''
    )
    kind = 'sensor_msgs/msg/JointState'
    numbers = {'position': np.array(position, float), 'velocity': np.zeros(0), 'effort': np.array(effort, float)}
    return store.serialize_cdr(types[kind](header=header, name=list(names), **numbers), kind)


def samples(stamp_of=lambda k: BEGIN + k * STEP, sign=1.0, torque_of=lambda torque: torque):
    """Return [(time of reception, message)] of the axis; `stamp_of` gives the stamp of sample k."""
    torque, angle = axis()
    values = zip(torque_of(torque), sign * angle, strict=True)
    return [(BEGIN + k * STEP, state(stamp_of(k), position=[y], effort=[u])) for k, (u, y) in enumerate(values)]


def write(path, messages, topic='/joint_states'):
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection(topic, 'sensor_msgs/msg/JointState', typestore=store)
        for received, data in messages:
            bag.write(connection, received, data)
    return path


def call(*options):
    app = typer.Typer()
    app.command()(identify_bag)
    return CliRunner().invoke(app, list(map(str, options)))


def identified(path, *options):
    """Return (K, a, all warnings) of the axis by the verb."""
    result = call(path, *OPTIONS, *options, '--json', path / 'all.json')
    assert result.exit_code == 0, result.output
    figures = json.loads((path / 'all.json').read_text())
    axis = figures['axes']['axis']
    return axis['gain'], axis['viscosity'], '\n'.join([*figures['notes'], *axis['warnings']])


SKIPPED = {
    'first message empty': ([(BEGIN - 1, state(BEGIN - 1, names=()))], '1 of 2001 messages are skipped'),
    'two publishers': (
        [(BEGIN + k * 10 * STEP + 1, state(BEGIN + k * 10 * STEP + 1, ('gripper',), [0.0], [0.0])) for k in range(100)],
        '100 of 2100 messages are skipped: 100 without effort[elbow]',
    ),
    'not a number': (
        [(BEGIN + 1, state(BEGIN + 1, position=[np.nan], effort=[np.nan]))],
        '1 of 2001 messages are skipped: 1 with effort[elbow] not finite',
    ),
    'stored twice': (samples()[100:200], '100 messages have the time of the one before; they are skipped'),
}


@pytest.mark.parametrize('case', SKIPPED)
def test_messages_without_a_sample_are_skipped_and_counted(tmp_path, case):
    extra, warning = SKIPPED[case]
    path = write(tmp_path / 'bag', sorted([*samples(), *extra], key=lambda message: message[0]))
    gain, viscosity, warnings = identified(path)
    assert warning in warnings
    assert gain == pytest.approx(GAIN, rel=0.02)
    assert viscosity == pytest.approx(VISCOSITY, rel=0.02)


def test_bag_with_all_stamps_zero_is_placed_by_reception(tmp_path):
    gain, viscosity, warnings = identified(write(tmp_path / 'bag', samples(lambda k: 0)))
    assert 'all 2000 header stamps are 0; the time of reception is used' in warnings
    assert gain == pytest.approx(GAIN, rel=0.02)
    assert viscosity == pytest.approx(VISCOSITY, rel=0.02)


def swapped(k):
    """Return stamps in which two neighbours have changed places: a best-effort reader reorders them."""
    return BEGIN + (k ^ 1 if k in (500, 501) else k) * STEP


def test_swapped_neighbours_are_sorted_with_a_warning(tmp_path):
    _, _, warnings = read_axis(write(tmp_path / 'bag', samples(swapped)), TORQUE, ANGLE)
    assert any('1 messages arrived after a later one' in text for text in warnings)


@pytest.mark.parametrize(
    ('stamp_of', 'reason'),
    [
        (lambda k: BEGIN, '1999 of 2000 messages have the time of the one before'),
        (lambda k: BEGIN + k // 5 * 5 * STEP, '1600 of 2000 messages have the time of the one before'),
        (
            lambda k: BEGIN + (k if k < 1000 else k - 250) * STEP,
            r'the clock steps back by 0\.498 s at message 1000; the usual step is 0\.002 s',
        ),
        (lambda k: BEGIN + k * STEP if k < 1000 else k * STEP, r'the clock steps back by 1\.79e\+09 s at message 1000'),
        (lambda k: BEGIN + (k if k < 1000 else k + 250) * STEP, 'has a gap of 502.0 ms'),
    ],
)
def test_clock_that_cannot_place_the_samples_is_refused(tmp_path, stamp_of, reason):
    path = write(tmp_path / 'bag', samples(stamp_of))
    with pytest.raises(IdentificationError, match=reason):
        read_axis(path, TORQUE, ANGLE)


def test_clocks_that_never_meet_are_named_with_both_spans(tmp_path):
    """The drive has stamps of a clock that began at start-up."""
    path, store = tmp_path / 'bag', get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        for topic, first in (('/drive', 5 * 10**9), ('/joint_states', BEGIN)):
            connection = bag.add_connection(topic, 'sensor_msgs/msg/JointState', typestore=store)
            for received, data in samples(lambda k, first=first: first + k * STEP)[:100]:
                bag.write(connection, received, data)
    with pytest.raises(IdentificationError) as refusal:
        read_axis(path, Signal('/drive', 'effort[elbow]'), ANGLE)
    assert '/drive effort[elbow] from 5.000 to 5.198 s (header stamps)' in str(refusal.value)
    assert 'position[elbow] from 1790000000.000 to 1790000000.198 s (header stamps)' in str(refusal.value)


def test_sign_that_is_turned_gets_a_warning(tmp_path):
    gain, viscosity, warnings = identified(write(tmp_path / 'bag', samples(sign=-1.0)))
    assert gain == pytest.approx(-GAIN, rel=0.02)
    assert viscosity == pytest.approx(VISCOSITY, rel=0.02)
    assert 'is negative: a positive drive moves the axis backwards' in warnings


def test_saturation_above_the_documented_share_is_refused(tmp_path):
    path = write(tmp_path / 'bag', samples(torque_of=lambda torque: np.clip(torque, -0.9, 0.9)))
    with pytest.raises(IdentificationError, match=r'the drive is saturated: \d\d\.\d % .* at 0.9 V; allowed 1 %'):
        raise call(path, *OPTIONS, '--limit', 0.9).exception


@pytest.mark.parametrize('option', [('--limit', 0), ('--limit', -1), ('--limit', 'nan'), ('--delay', 'nan')])
def test_limit_or_delay_out_of_range_is_refused(tmp_path, option):
    result = call(tmp_path, *OPTIONS, *option)
    assert result.exit_code == 2
    assert option[0] in result.output


def test_unit_with_an_offset_is_refused(tmp_path):
    path = write(tmp_path / 'bag', samples()[:50])
    with pytest.raises(IdentificationError, match="drive: 'degC' has an offset"):
        read_axis(path, Signal('/joint_states', 'effort[elbow]', 'degC'), ANGLE)


def test_field_that_no_message_has_is_refused_with_counts(tmp_path):
    path = write(tmp_path / 'bag', samples()[:50])
    with pytest.raises(BagError, match=r"no number at 'effort\[wrist\]' in 50 messages: 50 without effort\[wrist\]"):
        read_axis(path, Signal('/joint_states', 'effort[wrist]'), ANGLE)
