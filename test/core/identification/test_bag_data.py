"""Identification from bags: of this cell, of another machine by topics, fields and units, and from invalid bags."""

import json
import re
from functools import cache

import numpy as np
import pytest
import typer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner

from pkm_core.bag.message_types import typestore
from pkm_core.bag.signals import Signal
from pkm_core.bag.writer import BagWriter
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.errors import BagError, PkmError
from pkm_core.identification import IdentificationError
from pkm_core.identification.bag_data import read_axis, read_cell_bag
from pkm_core.identification.excitation import slow_moves, sweeps
from pkm_core.identification.frequency_response import estimate_response
from pkm_core.identification.identify import identify_joint
from pkm_core.jet import Jet
from pkm_core.machines import load_machine
from pkm_core.motion.trajectory import with_derivatives
from pkm_core.simulation.experiment import SimulatedCell
from pkm_core.verbs.identify_bag import identify_bag

TICK = 500_000  # ns
RUN = CliRunner()


@cache
def parts():
    machine = load_machine('planar')
    return machine, load_model(machine), load_control(machine)


@cache
def experiments():
    """Return [(Experiment, JointRecord)] of slow moves and one sweep of planar d1."""
    machine, models, gains = parts()
    cell = SimulatedCell(machine, gains, 1)
    planned = [slow_moves(machine, 'd1', models['d1']), *sweeps(machine, 'd1', models['d1'], gains['d1'], stations=1)]
    return [(each, cell.run(each)) for each in planned]


def write_cell_bag(path, experiment, record, *, ticks=None):
    """Write a bag as the recorder of the cell does, with the excitation of every joint."""
    machine, store = parts()[0], typestore()
    poses = with_derivatives(
        experiment.trajectory,
        machine.coordinates,
        machine.forward(Jet.from_derivatives(*experiment.trajectory.derivatives())),
    )
    kinds = {'/pkm/joint_trajectory': 'SampledTrajectory', '/pkm/pose_trajectory': 'SampledTrajectory'}
    for joint in machine.joints:
        kinds |= {f'/pkm/{joint}/encoder': 'EncoderSample', f'/pkm/{joint}/command': 'MotorCommand'}
    kinds |= {'/pkm/excitation': 'Excitation'}
    kinds = {topic: f'pkm_interfaces/msg/{kind}' for topic, kind in kinds.items()}
    bag = BagWriter(path, kinds, {})

    def put(topic, index, /, **fields):
        data = store.serialize_cdr(store.types[kinds[topic]](**fields), kinds[topic])
        bag.write(topic, bytes(data), index * TICK)

    for name, trajectory in (('joint', experiment.trajectory), ('pose', poses)):
        rows = ('position', 'velocity', 'acceleration', 'jerk')
        put(
            f'/pkm/{name}_trajectory', 0, cycle=1, kind=1, motion='identification', learning_law='none',
            sample_time=trajectory.sample_time, coordinates=list(trajectory.coordinates),
            move_starts=trajectory.move_starts.astype(np.uint32), move_ends=trajectory.move_ends.astype(np.uint32),
            feedforward=np.zeros(0), geometry='', planned='', stay=False, offset=0, hold=0,
            **{row: getattr(trajectory, row).ravel() for row in rows},
        )  # fmt: skip
    for axis, joint in enumerate(machine.joints):
        put('/pkm/excitation', 0, cycle=1, joint=joint, voltage=experiment.excitation[:, axis].copy())
    positions = record.counts * machine.encoder_resolution
    for k in range(len(record.counts) if ticks is None else ticks):
        for axis, joint in enumerate(machine.joints):
            same, position = {'tick': k, 'cycle': 1}, positions[k, axis]
            put(
                f'/pkm/{joint}/encoder',
                k,
                **same,
                index=k,
                mode=0,
                counts=int(record.counts[k, axis]),
                position=position,
            )
            error = record.reference[k, axis] - position
            put(f'/pkm/{joint}/command', k, **same, voltage=record.voltage[k, axis], error=error, feedforward=0.0)
    bag.close({})
    return path


@pytest.fixture(scope='module')
def cell_bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp('cell')
    return [write_cell_bag(folder / each.name, each, record) for each, record in experiments()]


def call(*options):
    app = typer.Typer()
    app.command()(identify_bag)
    return RUN.invoke(app, list(map(str, options)), catch_exceptions=False)


def test_cell_bag_holds_the_record_of_the_loop(cell_bags):
    machine = parts()[0]
    for path, (planned, record) in zip(cell_bags, experiments(), strict=True):
        read, warnings = read_cell_bag(machine, path)
        assert not warnings
        np.testing.assert_array_equal(read.counts, record.counts)
        np.testing.assert_array_equal(read.voltage, record.voltage)
        np.testing.assert_allclose(read.reference, record.reference, atol=1e-15)
        np.testing.assert_array_equal(read.excitation, planned.excitation)


def test_verb_on_bags_equals_the_fit_of_the_records(cell_bags, tmp_path):
    machine, models, gains = parts()
    direct = identify_joint(machine, 'd1', [record for _, record in experiments()], models, gains)
    result = call('--machine', 'planar', *cell_bags, '--out', tmp_path, '--json', tmp_path / 'all.json')
    assert result.exit_code == 0
    figures = json.loads((tmp_path / 'all.json').read_text())['axes']
    assert list(figures) == ['d1']  # d3 stood still
    assert figures['d1']['gain'] == pytest.approx(direct.low.gain, rel=1e-9)
    np.testing.assert_allclose(figures['d1']['modes'], direct.high.modes, rtol=1e-6)
    assert load_model(machine, tmp_path / 'model.yaml')['d3'] == models['d3']
    assert (tmp_path / 'fig_7_11_response_d1.png').is_file()


def test_bag_that_ends_early_is_used_with_a_warning(tmp_path):
    experiment, record = experiments()[0]
    path = write_cell_bag(tmp_path / 'short', experiment, record, ticks=5000)
    read, warnings = read_cell_bag(parts()[0], path)
    assert warnings == ['short: holds 5000 of 7600 ticks; the rest is missing']
    assert max(end for _, end in read.moves) < 5000
    result = call('--machine', 'planar', '--joint', 'd1', path)
    assert 'holds 5000 of 7600 ticks' in result.output.replace('\n', ' ')


def test_truncated_file_of_this_cell_is_refused(tmp_path):
    path = write_cell_bag(tmp_path / 'cut', *experiments()[0], ticks=2000)
    file = next(path.glob('*.mcap'))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(BagError, match=re.escape(str(path))):
        read_cell_bag(parts()[0], path)


def test_empty_bag_is_refused_with_numbers(tmp_path):
    experiment, record = experiments()[0]
    path = write_cell_bag(tmp_path / 'empty', experiment, record, ticks=0)
    with pytest.raises(IdentificationError, match='empty: 0 of 7600 ticks; at least 1'):
        read_cell_bag(parts()[0], path)


def test_bag_of_another_machine_is_refused(cell_bags):
    with pytest.raises(IdentificationError, match=r"joints \['d1', 'd3'\]; four_dof has"):
        read_cell_bag(load_machine('four_dof'), cell_bags[0])


def test_bag_of_a_sweep_alone_is_refused(cell_bags):
    with pytest.raises(PkmError, match='planar: no axis moves without excitation'):
        call('--machine', 'planar', cell_bags[1])


@pytest.mark.parametrize('damage', ['no bag', 'no metadata'])
def test_folder_without_a_bag_is_refused(tmp_path, damage):
    path = tmp_path / 'bag'
    if damage == 'no metadata':
        path.mkdir()
    with pytest.raises(BagError, match=str(path)):
        call('--machine', 'planar', path)


# axis of another machine: a joint in degrees with a torque drive, among others, at 500 Hz with jitter

GAIN, VISCOSITY, RATE = 4.0, 6.0, 500.0  # rad/s^2 per N m, 1/s, Hz


@cache
def elbow():
    """Return time [s], torque [N m], angle and reference [rad] and excitation [N m] of a joint under PD control."""
    draw, step = np.random.default_rng(3), 1 / RATE
    count, sub = 6000, 20
    time = np.arange(count) * step
    reference = 0.5 * (1 - np.cos(2 * np.pi * time / 1.5)) * (time < 6.0)
    excitation = np.where(time >= 6.2, 2.0 * draw.standard_normal(count), 0.0)
    angle, speed, angles, torques = 0.0, 0.0, np.zeros(count), np.zeros(count)
    for k in range(count):
        angles[k] = angle + 1e-6 * draw.standard_normal()
        before = angles[k - 1] if k else angles[k]
        torques[k] = 40.0 * (reference[k] - angles[k]) - 4.0 * (angles[k] - before) / step + excitation[k]
        for _ in range(sub):
            speed += step / sub * (GAIN * torques[k] - VISCOSITY * speed)
            angle += step / sub * speed
    return time, torques, angles, reference, excitation


def write_foreign_bag(path, *, joints=('shoulder', 'elbow'), count=None, gap=False, first=0):
    store = get_typestore(Stores.ROS2_JAZZY)
    State, Number = store.types['sensor_msgs/msg/JointState'], store.types['std_msgs/msg/Float64']
    Header, Time = store.types['std_msgs/msg/Header'], store.types['builtin_interfaces/msg/Time']
    time, torque, angle, reference, excitation = elbow()
    draw = np.random.default_rng(4)
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        topics = {'/joint_states': State, '/wanted': Number, '/shake': Number}
        connections = {
            topic: bag.add_connection(topic, kind.__msgtype__, typestore=store) for topic, kind in topics.items()
        }
        for k in range(first, len(time) if count is None else first + count):
            if gap and 1000 <= k < 1100:
                continue
            stamp = int(1e9 * (100.0 + time[k]))
            jitter = int(2e5 * draw.random())  # received up to 0.2 ms late
            state = State(
                header=Header(stamp=Time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=''),
                name=list(joints),
                position=np.array([0.0, np.degrees(angle[k])]),
                velocity=np.zeros(2),
                effort=np.array([0.0, 1e3 * torque[k]]),
            )
            bag.write(connections['/joint_states'], stamp + jitter, store.serialize_cdr(state, State.__msgtype__))
            for topic, value in (('/wanted', np.degrees(reference[k])), ('/shake', 1e3 * excitation[k])):
                data = store.serialize_cdr(Number(data=float(value)), Number.__msgtype__)
                bag.write(connections[topic], stamp, data)
    return path


TORQUE = Signal('/joint_states', 'effort[elbow]', 'mN m')
ANGLE = Signal('/joint_states', 'position[elbow]', 'deg')
OPTIONS = [
    *('--input-topic', '/joint_states', '--input-field', 'effort[elbow]', '--input-unit', 'mN m'),
    *('--output-topic', '/joint_states', '--output-field', 'position[1]', '--output-unit', 'deg'),
]


def test_axis_of_another_machine_is_read_in_si_units(tmp_path):
    path = write_foreign_bag(tmp_path / 'bag')
    data, dead_time, warnings = read_axis(path, TORQUE, ANGLE, delay=0.003)
    _, torque, angle, *_ = elbow()
    assert data.sample_time == pytest.approx(2e-3, rel=1e-6)
    assert (data.computation, dead_time) == (1, pytest.approx(1e-3))
    np.testing.assert_allclose(data.position, angle[: len(data.position)], atol=1e-9)
    np.testing.assert_allclose(data.voltage[1:-1], torque[1 : len(data.voltage) - 1], rtol=1e-9)
    assert not warnings


def test_verb_identifies_an_axis_of_another_machine(tmp_path):
    moves = write_foreign_bag(tmp_path / 'moves', count=3000)
    options = [
        *OPTIONS,
        '--overwrite',
        '--reference-topic',
        '/wanted',
        '--out',
        tmp_path,
        '--json',
        tmp_path / 'all.json',
    ]
    result = call(moves, *options)
    assert result.exit_code == 0
    axis = json.loads((tmp_path / 'all.json').read_text())['axes']['axis']
    assert axis['gain'] == pytest.approx(GAIN, rel=0.01)
    assert axis['viscosity'] == pytest.approx(VISCOSITY, rel=0.02)
    assert axis['reference_as_instrument']
    assert (tmp_path / 'moves_axis.png').is_file()
    assert not (tmp_path / 'model.yaml').exists()  # no axis of this cell


def test_excitation_of_another_machine_gives_the_response(tmp_path):
    shaken = write_foreign_bag(tmp_path / 'shaken', first=3000)
    data, _, _ = read_axis(shaken, TORQUE, ANGLE, excitation=Signal('/shake', 'data', 'mN m'))
    response = estimate_response(data, (15.0, 100.0))
    z = np.exp(2j * np.pi * response.frequency / RATE)
    decay = np.exp(-VISCOSITY / RATE)  # the held torque on K/(s (s + a))
    true = GAIN / VISCOSITY * ((1 / RATE) / (z - 1) - (1 - decay) / VISCOSITY / (z - decay))
    np.testing.assert_allclose(response.plant, true, rtol=0.1)  # leakage of the window, and 20 Euler steps per sample
    assert response.instrument
    assert not response.periodic


@pytest.mark.parametrize(
    ('options', 'error', 'reason'),
    [
        (
            {'drive': Signal('/nowhere')},
            BagError,
            r"has no topic \['/nowhere'\]; it has \['/joint_states', '/shake', '/wanted'\]",
        ),
        ({'drive': Signal('/joint_states', 'effort[wrist]')}, BagError, r"no number at 'effort\[wrist\]'"),
        ({'drive': Signal('/joint_states', 'torque')}, BagError, "no number at 'torque'"),
        (
            {'drive': Signal('/wanted', 'data', 'furlongs per beer')},
            IdentificationError,
            "'furlongs per beer' is not a unit",
        ),
        (
            {'reference': Signal('/wanted', 'data', 'mm')},
            IdentificationError,
            'reference in mm, sensor in deg; expected the same dimension',
        ),
    ],
)
def test_missing_signal_is_refused(tmp_path, options, error, reason):
    path = write_foreign_bag(tmp_path / 'bag', count=100)
    with pytest.raises(error, match=reason):
        read_axis(path, **({'drive': TORQUE, 'sensor': ANGLE} | options))


def test_bag_with_a_gap_is_refused_with_numbers(tmp_path):
    path = write_foreign_bag(tmp_path / 'bag', gap=True)
    with pytest.raises(IdentificationError, match=r'/joint_states has a gap of 202\.0 ms; allowed 20\.0 ms'):
        read_axis(path, TORQUE, ANGLE)


def test_bag_with_one_message_is_refused_with_numbers(tmp_path):
    path = write_foreign_bag(tmp_path / 'bag', count=1)
    with pytest.raises(PkmError, match='/joint_states has 1 messages; at least 2 are needed'):
        read_axis(path, TORQUE, ANGLE)


def test_truncated_file_of_another_machine_is_refused(tmp_path):
    path = write_foreign_bag(tmp_path / 'bag')
    file = next(path.glob('*.db3'))
    file.write_bytes(file.read_bytes()[:5000])
    with pytest.raises(BagError, match='cannot be read as a bag'):
        read_axis(path, TORQUE, ANGLE)


def test_missing_output_topic_is_refused(tmp_path):
    with pytest.raises(PkmError, match='--output-topic: is missing'):
        call(tmp_path, '--input-topic', '/joint_states')


def test_band_beyond_half_the_sampling_rate_is_refused(tmp_path):
    path = write_foreign_bag(tmp_path / 'bag')
    with pytest.raises(IdentificationError, match=r'band 5 to 300 Hz; expected 0 < from < to < 250 Hz'):
        call(path, *OPTIONS, '--band', '5', '300')
