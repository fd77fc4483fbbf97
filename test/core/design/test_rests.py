"""Rests of recorded signals as measurements: averages with their deviation, bags, and refusals with pose and number."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner

from pkm_core.bag.signals import Signal
from pkm_core.control.robust import load_control
from pkm_core.design.calibration_motion import calibration_motion
from pkm_core.design.measurement import load_laser
from pkm_core.design.pose_plan import spread_poses
from pkm_core.design.rest_bags import rests_from_bag, rests_from_signals
from pkm_core.design.rests import joined, rests_from_arrays
from pkm_core.errors import PkmError
from pkm_core.machines import load_machine
from pkm_core.machines.identity import Specimen
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles
from pkm_core.verbs.calibrate import calibrate

PLANAR, FOUR_DOF, LASER = load_machine('planar'), load_machine('four_dof'), load_laser()
SEED = 5


@pytest.fixture(scope='module')
def cycle():
    """Return a simulated cycle of five rests: trajectories, signals of encoders and laser, windows [s]."""
    (planned,) = calibration_motion(PLANAR, spread_poses(PLANAR, 5, 1), move_time=0.1)
    joints = to_joints(PLANAR, planned.trajectory)
    records = run_cycles(PLANAR, joints, load_control(PLANAR), None, 1, SEED, laser=True)
    return SimpleNamespace(
        poses=planned.trajectory,
        joints=joints,
        time=PLANAR.sample_time * np.arange(len(joints)),
        q=records.counts[0] * PLANAR.encoder_resolution,
        laser_time=records.laser[0].time,
        seen=records.laser[0].displacement,
        windows=PLANAR.sample_time * planned.windows,
        error=records.error[0],
        voltage=records.voltage[0],
    )


def averaged(cycle, **changes):
    given = {name: getattr(cycle, name) for name in ('time', 'q', 'laser_time', 'seen', 'windows')} | changes
    return rests_from_arrays(PLANAR, *given.values(), LASER)


def test_deviation_states_the_spread_of_averages():
    """Readings of a value at rest with known noise and rounding, many times: the stated deviation is that found."""
    draw, rests, per_rest = np.random.default_rng(1), 300, 125
    time = 0.8e-3 * np.arange(rests * per_rest)
    place = draw.uniform(-50e-6, 50e-6, (rests, 2))
    noisy = np.repeat(place, per_rest, axis=0) + 0.2e-6 * draw.standard_normal((len(time), 2))
    seen = 0.91e-6 * np.round(noisy / 0.91e-6)
    q = np.tile(PLANAR.home, (len(time), 1))
    windows = np.stack([time[::per_rest], time[::per_rest] + per_rest * 0.8e-3], axis=1)
    exact = LASER.model_copy(update={'encoder_error': 0.0})
    found = rests_from_arrays(PLANAR, time, q, time, seen, windows, exact)
    spread = (found.displacement - place).std(axis=0)
    np.testing.assert_allclose(found.deviation, spread, rtol=0.15)  # 300 rests: 4 % of standard error
    plain = seen.reshape(rests, per_rest, 2).mean(axis=1)
    assert (spread < 0.6 * (plain - place).std(axis=0)).all()  # the mean alone keeps the rounding


def test_averages_keep_the_rests_of_a_cycle(cycle):
    found = averaged(cycle)
    assert found.q.shape == found.displacement.shape == (5, 2)
    assert ((found.deviation > 1e-8) & (found.deviation < 0.1e-6)).all()
    wanted = cycle.joints.position[np.round(cycle.windows[:, 0] / PLANAR.sample_time).astype(int)]
    np.testing.assert_allclose(found.q, wanted, atol=1e-6)


def test_coarse_rounding_without_noise_is_stated_as_such(cycle):
    """Readings that never change within a rest hide the value within a step: its uniform deviation is stated."""
    still = np.array([0.91e-6 * np.round(row / 0.91e-6) for row in cycle.seen])
    for begin, end in cycle.windows:
        rows = (cycle.laser_time >= begin) & (cycle.laser_time < end)
        still[rows] = still[rows][0]
    assert averaged(cycle, seen=still).deviation == pytest.approx(0.91e-6 / np.sqrt(12.0), rel=0.05)


def spoiled(values, row, value):
    copy = values.copy()
    copy[row] = value
    return copy


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        (lambda c: {'seen': spoiled(c.seen, (c.laser_time > c.windows[2, 0] + 0.01, 1), np.nan)},
         r'pose 2: laser from 0\.\d+ to 0\.\d+ s: y is nan at 0\.\d+ s; expected a finite number'),
        (lambda c: {'q': spoiled(c.q, (c.time > c.windows[1, 0], 0), np.inf)}, r'pose 1: encoders .*: d1 is inf at'),
        (lambda c: {'laser_time': spoiled(c.laser_time, 700, 0.1)}, r'laser: stamp 700 is 0.100000 s after 0.559200 s'),
        (lambda c: {'time': spoiled(c.time, 50, np.nan)}, r'encoders: stamp 50 is not finite'),
        (lambda c: {'laser_time': c.laser_time[:500], 'seen': c.seen[:500]}, r'pose 1: laser .*: 0 samples; expected'),
        (lambda c: {'seen': np.ones_like(c.seen)}, r'laser: x, y has one value in all 5 rests'),
        (lambda c: {'windows': c.windows - 0.12}, r'pose 0: d\d moves by \d+\.\d um during the average; allowed 20 um'),
        (lambda c: {'seen': c.seen[:, :1]}, r'laser: values of shape \(\d+, 1\); expected \(\d+, 2\)'),
        (lambda c: {'windows': []}, r'rests: 0 given'),
    ],
)  # fmt: skip
def test_bad_signal_is_refused_with_pose_and_number(cycle, change, reason):
    with pytest.raises(PkmError, match=reason):
        averaged(cycle, **change(cycle))


def test_measurements_of_two_specimens_are_not_joined(cycle):
    one = averaged(cycle)._replace(specimen=Specimen.simulated('planar', 1, 'hard'))
    with pytest.raises(PkmError, match='of planar, seed 2, environment hard beside planar, seed 1, environment hard'):
        joined([one, one._replace(specimen=Specimen.simulated('planar', 2, 'hard'))])
    assert len(joined([one, one]).q) == 10


# bags


def cell_bag(start_recording, cycle, facts=None, samples=None):
    recorded = SimpleNamespace(machine=PLANAR, poses=cycle.poses, joints=cycle.joints, error=cycle.error,
                               voltage=cycle.voltage)  # fmt: skip
    metadata = {'motion': 'poses', **({} if facts is None else {'machine': 'planar', 'parameters': json.dumps(facts)})}
    recording = start_recording(recorded, laser=True, metadata=metadata, first_tick=4000)
    recording.ticks(samples)
    for time, displacement in zip(cycle.laser_time, cycle.seen, strict=True):
        recording.laser(time, displacement)
    return recording.close()


def test_bag_of_a_cell_gives_the_averages_and_its_specimen(cycle, start_recording):
    path = cell_bag(start_recording, cycle, {'machine': {'seed': SEED, 'environment': 'nominal'}})
    read, direct = rests_from_bag(path, PLANAR, LASER), averaged(cycle)
    np.testing.assert_allclose(read.q, direct.q, atol=1e-12)
    np.testing.assert_allclose(read.displacement, direct.displacement, atol=1e-12)
    assert read.specimen == Specimen.simulated('planar', SEED, 'nominal')
    with pytest.raises(PkmError, match=r"joints \['d1', 'd3'\]; expected those of four_dof"):
        rests_from_bag(path, FOUR_DOF, LASER)


def test_bag_without_a_simulated_machine_is_of_a_real_one(cycle, start_recording):
    path = cell_bag(start_recording, cycle, {'recorder': {}})
    assert rests_from_bag(path, PLANAR, LASER).specimen == Specimen.measured('planar')


def test_bag_that_ends_early_is_not_measured(cycle, start_recording):
    path = cell_bag(start_recording, cycle, samples=1500)
    with pytest.raises(PkmError, match=r'poses_0001|short_0001: holds 1500 of \d+ ticks; expected a complete cycle'):
        rests_from_bag(path, PLANAR, LASER)


def foreign_bag(path, cycle, back=None):
    """Write encoders in counts on one topic per joint and the laser in um as a vector, with their own stamps."""
    store = get_typestore(Stores.ROS2_JAZZY)
    names = ('std_msgs/msg/Float64', 'geometry_msgs/msg/Vector3Stamped', 'std_msgs/msg/Header',
             'builtin_interfaces/msg/Time', 'geometry_msgs/msg/Vector3')  # fmt: skip
    number, vector, header, stamp, point = (store.types[name] for name in names)
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        topics = {f'/scale/{joint}': bag.add_connection(f'/scale/{joint}', number.__msgtype__, typestore=store)
                  for joint in PLANAR.joints}  # fmt: skip
        topics['/tracker'] = bag.add_connection('/tracker', vector.__msgtype__, typestore=store)
        for time, q in zip(cycle.time, cycle.q, strict=True):
            for joint, value in zip(PLANAR.joints, q, strict=True):
                data = number(data=value / PLANAR.encoder_resolution)
                bag.write(topics[f'/scale/{joint}'], round(1e9 * time), store.serialize_cdr(data, number.__msgtype__))
        for k, (time, seen) in enumerate(zip(cycle.laser_time, cycle.seen, strict=True)):
            nanoseconds = round(1e9 * (time if k != back else time - 0.01))
            at = header(stamp=stamp(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9), frame_id='')
            data = vector(header=at, vector=point(x=1e6 * seen[0], y=1e6 * seen[1], z=0.0))
            bag.write(topics['/tracker'], round(1e9 * time), store.serialize_cdr(data, vector.__msgtype__))
    return path


def foreign_rests(path, **changes):
    encoders = [Signal(f'/scale/{joint}', 'data', '0.2 um') for joint in PLANAR.joints]
    laser = [Signal('/tracker', f'vector.{name}', changes.get('unit', 'um')) for name in 'xy']
    return rests_from_signals(path, PLANAR, LASER, encoders, laser, rest=changes.get('rest', 0.125))


def test_bag_of_another_recorder_gives_the_same_rests(cycle, tmp_path):
    found, direct = foreign_rests(foreign_bag(tmp_path / 'bag', cycle)), averaged(cycle)
    assert found.specimen == Specimen.measured('planar')
    np.testing.assert_allclose(found.q[: len(direct.q)], direct.q, atol=0.5e-6)  # other windows of the same rests
    shift = found.displacement[: len(direct.q)] - direct.displacement
    np.testing.assert_allclose(shift, 0.0, atol=0.6e-6)


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'back': 300}, r'bag: /tracker: stamp 300 is 0.230000 s after 0.239200 s; expected rising stamps'),
        ({'rest': 2.0}, r'bag: no rest of 2 s in 1.\d* s; a rest has all encoders within 5 um'),
        ({'unit': 's'}, r"bag: x: unit 's'; expected a unit of length"),
        ({'unit': 'beer'}, r"bag: x: 'beer' is not a unit"),
        ({'rest': 0.05}, r'rest of 0.05 s; allowed from 0.12 s'),
    ],
)
def test_bad_bag_of_another_recorder_is_refused(cycle, tmp_path, changes, reason):
    path = foreign_bag(tmp_path / 'bag', cycle, changes.pop('back', None))
    with pytest.raises(PkmError, match=reason):
        foreign_rests(path, **changes)


# the command


def calibrate_bags(folder, *options):
    app = typer.Typer()
    app.command()(calibrate)
    out = ('--machine', 'planar', '--overwrite', '--out', folder / 'out', '--json', folder / 'found.json')
    result = CliRunner().invoke(app, list(map(str, (*options, *out))), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads((folder / 'found.json').read_text())


def test_command_calibrates_from_bags_of_a_cell(cycle, start_recording, tmp_path):
    """One bag three times and more is enough for the command; its poses are few, and its file names the specimen."""
    path = cell_bag(start_recording, cycle, {'machine': {'seed': SEED, 'environment': 'nominal'}})
    found = calibrate_bags(tmp_path, *('--bag', path) * 4)
    assert (found['poses_used'], found['poses_held_out']) == (15, 5)
    assert found['specimen'] == 'planar, seed 5, environment nominal'
    assert found['errors']['calibrated']['x_um'] < 0.2 < found['errors']['drawing']['x_um']
    known = load_machine(tmp_path / 'out' / 'calibrated' / 'planar.yaml')
    known.check_specimen(SEED, 'nominal')
    again = calibrate_bags(tmp_path, '--measurements', tmp_path / 'out' / 'measurements.csv')
    assert again['specimen'] == found['specimen']
    assert again['misfit'] == pytest.approx(found['misfit'], rel=1e-3)


def test_command_calibrates_from_bags_of_another_recorder(cycle, tmp_path):
    path = foreign_bag(tmp_path / 'bag', cycle)
    encoders = [part for joint in PLANAR.joints for part in ('--encoder-topic', f'/scale/{joint}')]
    laser = (
        '--laser-topic',
        '/tracker',
        '--laser-field',
        'vector.x',
        '--laser-field',
        'vector.y',
        '--laser-unit',
        'um',
    )
    options = (*('--bag', path) * 4, *encoders, '--encoder-unit', '0.2 um', *laser, '--rest', 125)
    found = calibrate_bags(tmp_path, *options)
    assert found['specimen'] == 'planar, measured machine'
    assert found['errors']['calibrated']['x_um'] < 0.3 < found['errors']['drawing']['x_um']
    with pytest.raises(PkmError, match=r"--laser-field: 1 given; expected one per name of \['x', 'y'\]"):
        calibrate_bags(tmp_path, *options[: -len(laser) - 2], '--laser-topic', '/tracker')
