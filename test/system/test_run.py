"""`pkm run` on the real graph, composed and in separate processes."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.message_types import typestore
from pkm_core.bag.reader import read_metadata
from pkm_core.control.controllers import choose_control
from pkm_core.control.robust import load_control
from pkm_core.learning import make_law
from pkm_core.learning.initial import first_feedforward
from pkm_core.learning.store import read
from pkm_core.learning.tool import ToolLearning, make_tool_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.cycles import run_cycles

DOMAIN = 61
PKM = Path(sys.prefix) / 'bin' / 'pkm'
JOINTS = ('d1', 'd3', 'd5', 'd7')


@pytest.fixture(scope='module')
def runs(tmp_path_factory, module_processes):
    """Return the output folders of two learning cycles, by arrangement; each has a pace, which changes no bit."""
    folders = {}
    for arrangement, pace in (('composed', 2.0), ('processes', 1.0)):
        folder = tmp_path_factory.mktemp(arrangement)
        done = module_processes.run(
            *(PKM, 'run', '--cycles', 2, '--law', 'fourier_pid', '--seed', 7),
            *('--arrangement', arrangement, '--out', folder, '--json', folder / 'copy.json'),
            *('--save-learned', folder / 'learned.npz', '--pace', pace),
        )
        assert done.returncode == 0, done.stdout + done.stderr
        folders[arrangement] = (folder, done.stdout)
    return folders


def cycles_of(folder):
    return [read_cycle(path) for path in sorted((folder / 'bags').iterdir())]


@pytest.fixture(scope='module')
def simulated():
    """Return the same two cycles without ROS."""
    machine = load_machine('four_dof')
    trajectory = to_joints(machine, plan(machine, load_motion('four_dof_70ms')))
    gains = load_control(machine)
    return run_cycles(machine, trajectory, gains, make_law('fourier_pid', machine, gains), cycles=2, seed=7)


@pytest.mark.parametrize('arrangement', ['composed', 'processes'])
def test_graph_gives_the_bits_of_the_simulation_without_ros(runs, simulated, arrangement):
    for number, record in enumerate(cycles_of(runs[arrangement][0])):
        assert np.array_equal(record.counts, simulated.counts[number])
        assert np.array_equal(record.voltage, simulated.voltage[number])
        assert np.array_equal(record.error, simulated.error[number])


# every law and both kinds of control, every machine, both arrangements; three cycles are two updates
@pytest.mark.parametrize(
    ('machine', 'options', 'arrangement', 'cycles'),
    [
        ('planar', {'controller': 'planar_thesis', 'law': 'fourier'}, 'composed', 3),
        ('xy_stage', {'law': 'inverse'}, 'composed', 3),
        ('planar', {'law': 'norm_optimal', 'motion': 'planar_limits'}, 'processes', 3),
        ('four_dof', {'law': 'basis'}, 'composed', 3),
        ('planar', {'controller': 'computed_torque', 'environment': 'flexible'}, 'composed', 3),
        ('planar', {'controller': 'observer', 'law': 'inverse'}, 'composed', 3),
        # without pauses for learning the recorder has to keep apart cycles that follow each other at once
        ('four_dof', {'controller': 'computed_torque'}, 'processes', 4),
        ('xy_stage', {'law': 'none'}, 'composed', 30),
        # the laser, temperatures and what they change take part
        ('four_dof', {'law': 'inverse', 'learning-target': 'tool', 'environment': 'warm'}, 'processes', 3),
    ],
)
def test_every_law_and_control_gives_the_bits_of_the_simulation(
    processes, tmp_path, machine, options, arrangement, cycles
):
    options = {'controller': 'robust', 'law': 'none'} | options
    words = [word for name, value in options.items() for word in (f'--{name}', value)]
    done = processes.run(
        *(PKM, 'run', '--machine', machine, '--cycles', cycles, '--seed', 3, '--arrangement', arrangement),
        *(*words, '--out', tmp_path / 'out'),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert ' 0 lost' in done.stdout
    assert_bits_of_simulation(tmp_path / 'out')


def assert_bits_of_simulation(folder):
    """Compare every tick recorded by `pkm run` with the same cycles without ROS."""
    results = json.loads((folder / 'results.json').read_text())
    machine, name, motion = load_machine(results['machine']), results['law'], results['motion']
    poses = plan(machine, load_motion(motion))
    trajectory = to_joints(machine, poses)
    gains = choose_control(machine, results['control'])
    start = None
    if results['learned']:
        start = first_feedforward(results['learned'], machine, motion, name, gains, trajectory)
    law = None if name == 'none' else make_law(name, machine, gains)
    records, tool = cycles_of(folder), None
    if results['learning_target'] == 'tool':
        tool = ToolLearning(make_tool_law(machine, gains, law, poses, trajectory))
    seed, environment = results['seed'], results['environment']
    expected = run_cycles(machine, trajectory, gains, law, len(records), seed, environment, start=start, tool=tool)
    for number, record in enumerate(records):
        for kind in ('counts', 'voltage', 'error', 'feedforward'):
            assert np.array_equal(getattr(record, kind), getattr(expected, kind)[number]), (kind, number)
    assert results['notices'] == list(expected.notices)


def test_rates_and_frames_of_the_docs_match_a_recorded_cycle(runs):
    """docs/interfaces.md, row by row; topics of wall time, or not recorded in motions, are omitted."""
    page = (Path(__file__).parents[2] / 'docs' / 'interfaces.md').read_text(encoding='utf-8')
    rows = [line.strip('|').split('|') for line in page.splitlines() if re.match(r'\| `/(pkm|clock|diag)', line)]
    rows = [[cell.strip(' `') for cell in row] for row in rows if len(row) == 7]  # topics; services have fewer columns
    (bag, *_) = sorted((runs['composed'][0] / 'bags').iterdir())
    with AnyReader([bag], default_typestore=typestore()) as reader:
        counts = {name: info.msgcount for name, info in reader.topics.items()}
        ticks, frames = counts['/pkm/d1/encoder'], frames_of(reader)
    often = {
        'every tick': ticks,
        'once per cycle': 1,
        'none': 0,
        'every 20 ticks': ticks / 20,
        'every 100 ticks': ticks / 100,
        '0.8 ms': ticks * 0.5 / 0.8,
    }
    left_out = set()
    for topic, _, _, rate, _, frame, _ in rows:
        for name in {topic.replace('<joint>', joint) for joint in JOINTS}:
            expected = often.get(re.split('[,;]', rate)[0])
            if name in counts and expected is not None:
                assert abs(counts[name] - expected) <= (0 if expected in (0, 1, ticks) else 1), (name, counts[name])
            else:
                left_out.add(name)
            if name in frames:
                assert frames[name] == (frame if frame != '-' else ''), name
    not_recorded = {'/pkm/recorder/tick', '/pkm/machine/cycle', '/clock', '/diagnostics', '/pkm/cycle_events'}
    not_recorded |= {'/pkm/geometry', '/pkm/pose_with_covariance', '/pkm/joint_correction'}
    not_recorded |= {'/pkm/transforms', '/pkm/transforms_static', '/pkm/robot_description', '/pkm/machine/standing'}
    assert left_out == not_recorded | {f'/pkm/{joint}/cycle_error' for joint in JOINTS}
    assert counts['/pkm/cycle_events'] >= 6  # RECORDED follows the closing of the bag
    assert {name for name, frame in frames.items() if frame} == {'/pkm/pose', '/pkm/twist', '/pkm/markers'}


def frames_of(reader):
    """Return {topic: frame of its last message} for messages with a header."""
    frames = {}
    for connection, _, data in reader.messages():
        message = reader.deserialize(data, connection.msgtype)
        header = getattr((getattr(message, 'markers', None) or [message])[0], 'header', None)
        if header is not None:
            frames[connection.topic] = header.frame_id
    return frames


def test_saved_feedforward_is_the_best_applied(runs, simulated):
    files = [read(folder / 'learned.npz') for folder, _ in runs.values()]
    rms = np.sqrt(np.mean(np.square(simulated.error), axis=1))
    for axis, best in enumerate(rms.argmin(axis=0)):
        for learned in files:
            assert np.array_equal(learned.feedforward[:, axis], simulated.feedforward[best, :, axis])
    assert files[0].origin == files[1].origin


def test_run_starts_with_a_saved_feedforward(processes, runs, tmp_path):
    learned = runs['processes'][0] / 'learned.npz'
    done = processes.run(
        *(PKM, 'run', '--cycles', 2, '--law', 'fourier_pid', '--learned', learned, '--out', tmp_path / 'out'),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert_bits_of_simulation(tmp_path / 'out')
    first = cycles_of(tmp_path / 'out')[0]
    assert max(axis.max_dynamic_error for axis in first.metrics()) < 20e-6


def test_feedforward_of_another_machine_is_refused_in_one_line(processes, runs):
    learned = runs['composed'][0] / 'learned.npz'
    done = processes.run(PKM, 'run', '--machine', 'planar', '--cycles', 1, '--learned', learned)
    assert done.returncode == 1
    assert "learned.npz: was learned for another machine 'four_dof', here 'planar'; motion" in done.stderr
    assert 'Traceback' not in done.stderr


def test_two_seeds_give_different_encoder_sequences(simulated):
    machine = load_machine('four_dof')
    trajectory = to_joints(machine, plan(machine, load_motion('four_dof_70ms')))
    other = run_cycles(machine, trajectory, load_control(machine), None, cycles=1, seed=8)
    assert not np.array_equal(other.counts[0], simulated.counts[0])


@pytest.mark.parametrize('arrangement', ['composed', 'processes'])
def test_every_tick_of_every_axis_is_recorded(runs, arrangement):
    results = json.loads((runs[arrangement][0] / 'results.json').read_text())
    assert results['ticks'] == 2 * 680
    for joint in JOINTS:
        for kind in ('encoder', 'command'):
            assert results['messages'][f'/pkm/{joint}/{kind}'] == {'recorded': 1360, 'expected': 1360}
    for topic, count in results['messages'].items():
        assert count['expected'] in (None, count['recorded']), topic


def test_results_have_settings_and_figures_of_the_bags(runs):
    folder, _ = runs['processes']
    results = json.loads((folder / 'results.json').read_text())
    assert json.loads((folder / 'copy.json').read_text()) == results
    assert {key: results[key] for key in ('machine', 'motion', 'law', 'seed', 'arrangement', 'sample_time_s')} == {
        'machine': 'four_dof',
        'motion': 'four_dof_70ms',
        'law': 'fourier_pid',
        'seed': 7,
        'arrangement': 'processes',
        'sample_time_s': 0.0005,
    }
    assert len(results['config_hash']) == 12
    assert results['ticks_per_second'] > 0
    assert results['pace']['asked'] == 1.0
    assert 0.0 < results['pace']['reached'] < 1.01
    assert 0.0 <= results['pace']['late_mean_us'] <= results['pace']['late_largest_us']
    for cycle, record in zip(results['cycles'], cycles_of(folder), strict=True):
        assert cycle['bag'] == record.path.name
        for column, joint in enumerate(JOINTS):
            moving = [slice(a, b + 1) for a, b in zip(record.move_starts, record.move_ends, strict=True)]
            largest = max(np.abs(record.error[move, column]).max() for move in moving)
            assert cycle['axes'][joint]['max_dynamic_error_um'] == pytest.approx(1e6 * largest)
            assert set(cycle['axes'][joint]) == {
                *('max_dynamic_error_um', 'settling_5um_ms', 'settling_1um_ms', 'steady_state_error_um')
            }


def test_bags_have_the_settings_of_the_run(runs):
    folder = runs['composed'][0]
    first, second = (read_metadata(path) for path in sorted((folder / 'bags').iterdir()))
    data = second['custom_data']
    parameters = json.loads(data['parameters'])
    assert parameters['machine']['seed'] == 7
    assert parameters['joint_controller_d5']['joint'] == 'd5'
    assert None not in parameters.values(), 'every node has answered'
    assert data['config_hash'] == json.loads((folder / 'results.json').read_text())['config_hash']
    assert (data['machine'], data['learning_law'], data['cycle']) == ('four_dof', 'fourier_pid', '2')
    assert json.loads(data['lost']) == {}
    assert len(set(json.loads(data['learned_feedforward']).values())) == 4
    assert set(json.loads(first['custom_data']['learned_feedforward']).values()) == {''}
    counts = {topic['topic_metadata']['name']: topic['message_count'] for topic in second['topics_with_message_count']}
    assert all(counts[f'/pkm/{name}'] for name in ('pose', 'twist', 'joint_states', 'markers', 'laser'))


def test_learning_lowers_the_error_of_every_axis(runs):
    first, second = cycles_of(runs['composed'][0])
    for before, after in zip(first.metrics(), second.metrics(), strict=True):
        assert after.max_dynamic_error < 0.6 * before.max_dynamic_error


def test_run_prints_a_table_and_writes_a_figure(runs):
    folder, printed = runs['composed']
    assert 'largest dynamic error' in printed
    assert '0 lost' in printed
    assert re.search(r'pace 2 asked, [\d.]+ reached in the last cycle; ticks began late by \d+ us \(mean\)', printed)
    assert all(joint in printed for joint in JOINTS)
    assert (folder / 'learning.png').read_bytes().startswith(b'\x89PNG')


def test_bags_are_read_by_rosbags_and_mcap(runs):
    folder, _ = runs['composed']
    bag = sorted((folder / 'bags').iterdir())[0]
    with AnyReader([bag], default_typestore=typestore()) as reader:
        positions = [
            reader.deserialize(data, connection.msgtype).position
            for connection, _, data in reader.messages()
            if connection.topic == '/pkm/d3/encoder'
        ]
    assert len(positions) == 680
    with next(bag.glob('*.mcap')).open('rb') as stream:
        messages = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(['/pkm/d3/encoder'])
        assert [message.position for _, _, _, message in messages] == positions


@pytest.mark.parametrize(
    ('options', 'complaint'),
    [
        (['--machine', 'hexapod'], "machines: 'hexapod' is unknown"),
        (['--motion', 'planar_80ms'], 'planar'),
        (['--controller', 'soft'], "control: 'soft' given; allowed: ['robust', 'computed_torque', 'observer']"),
        (
            ['--controller', 'computed_torque', '--law', 'basis'],
            "'basis' given; --controller computed_torque does not learn",
        ),
        (['--law', 'none', '--save-learned', 'x.npz'], '--save-learned: given with --law none, which learns nothing'),
        (['--pace', -1], '--pace: -1.0 given; allowed: 0 (as fast as possible), or 0.01 to 1000 times real time'),
        (['--pace', 'nan'], '--pace: nan given; allowed: 0 '),
        (['--pace', 1, '--without', 'machine'], '--pace: 1.0 given with --without machine'),
        (['--law', 'magic'], "'magic' is unknown; known: ['none', 'basis'"),
        (['--environment', 'moon'], 'moon'),
        (['--out', '/proc/nowhere'], '/proc/nowhere: cannot be written'),
    ],
)
def test_invalid_option_is_refused_in_one_line(processes, options, complaint):
    done = processes.run(PKM, 'run', '--cycles', 1, *options)
    assert done.returncode == 1
    assert complaint in done.stderr
    assert 'Traceback' not in done.stderr
