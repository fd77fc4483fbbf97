"""Learned feedforward on disk: round trip, and refusal of other origins and files."""

import hashlib
import os
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.errors import LearningError
from pkm_core.learning import store
from pkm_core.learning.initial import first_feedforward
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints

MACHINE = load_machine('planar')
GAINS = load_control(MACHINE)
TRAJECTORY = to_joints(MACHINE, plan(MACHINE, load_motion('planar_80ms')))
ORIGIN = store.origin_of(MACHINE, 'planar_80ms', 'basis', GAINS, TRAJECTORY)
PARAMETERS = {'d1': {'velocity': 0.1 + 0.2}, 'd3': {'velocity': -1e-17}}


@pytest.fixture
def path(tmp_path):
    feedforward = np.random.default_rng(6).standard_normal(TRAJECTORY.position.shape)
    store.save(tmp_path / 'learned.npz', store.Learned(ORIGIN, feedforward, PARAMETERS))
    return tmp_path / 'learned.npz'


def test_loaded_feedforward_has_the_bits_of_the_saved_one(path):
    expected = np.random.default_rng(6).standard_normal(TRAJECTORY.position.shape)
    np.testing.assert_array_equal(store.load(path, ORIGIN), expected)
    assert store.load_parameters(path, ORIGIN) == PARAMETERS
    assert store.read(path).origin == ORIGIN


@pytest.mark.parametrize('field', ['machine', 'motion', 'sample_time', 'config', 'reference'])
def test_feedforward_of_another_origin_is_refused_by_difference(path, field):
    with pytest.raises(LearningError, match=f'was learned for another {field} .*, here 7'):
        store.load(path, replace(ORIGIN, **{field: 7}))


def test_feedforward_but_not_parameters_loads_under_another_law(path):
    other = replace(ORIGIN, law='inverse')
    store.load(path, other)
    with pytest.raises(LearningError, match="another law 'basis', here 'inverse'"):
        store.load_parameters(path, other)


def test_parameters_hold_for_another_motion(path):
    assert store.load_parameters(path, replace(ORIGIN, motion='other', reference='0')) == PARAMETERS


def test_origin_differs_by_machine_gains_and_motion():
    softer = {joint: axis_gains.model_copy(update={'kp': 0.9 * axis_gains.kp}) for joint, axis_gains in GAINS.items()}
    other = store.origin_of(MACHINE, 'planar_80ms', 'basis', softer, TRAJECTORY)
    assert other.config != ORIGIN.config
    assert other.reference == ORIGIN.reference
    longer = load_motion('planar_80ms').model_copy(update={'move_time': 90e-3})
    moved = store.origin_of(MACHINE, 'planar_80ms', 'basis', GAINS, to_joints(MACHINE, plan(MACHINE, longer)))
    assert moved.reference != ORIGIN.reference
    assert moved.config == ORIGIN.config
    assert store.origin_of(MACHINE, 'planar_80ms', 'basis', GAINS, TRAJECTORY) == ORIGIN


@pytest.mark.parametrize('content', [b'', b'no zip', b'PK\x03\x04 broken'])
def test_file_of_another_kind_is_refused(tmp_path, content):
    path = tmp_path / 'wrong.npz'
    path.write_bytes(content)
    with pytest.raises(LearningError, match=r'wrong.npz: (is not a file of learned feedforward|cannot be read)'):
        store.load(path, ORIGIN)


def test_missing_file_and_foreign_archive_are_refused(tmp_path):
    with pytest.raises(LearningError, match='cannot be read: No such file'):
        store.load(tmp_path / 'none.npz', ORIGIN)
    np.savez(tmp_path / 'foreign.npz', a=np.zeros(3))
    with pytest.raises(LearningError, match='is not a file of learned feedforward'):
        store.load(tmp_path / 'foreign.npz', ORIGIN)


@pytest.mark.parametrize('feedforward', [np.full((4, 2), np.nan), np.zeros(4), np.zeros((4, 2), dtype=int)])
def test_feedforward_of_wrong_type_or_shape_is_refused(tmp_path, feedforward):
    store.save(tmp_path / 'odd.npz', store.Learned(ORIGIN, feedforward, {}))
    with pytest.raises(LearningError, match='expected finite float64'):
        store.load(tmp_path / 'odd.npz', ORIGIN)


def test_file_without_parameters_is_refused_for_parameters(tmp_path):
    store.save(tmp_path / 'plain.npz', store.Learned(ORIGIN, np.zeros((4, 2)), {}))
    with pytest.raises(LearningError, match='has no parameters'):
        store.load_parameters(tmp_path / 'plain.npz', ORIGIN)


def test_folder_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(LearningError, match='cannot be written: No such file'):
        store.save(tmp_path / 'none' / 'x.npz', store.Learned(ORIGIN, np.zeros((4, 2)), {}))


def test_file_that_is_none_of_ours_is_not_overwritten(path, tmp_path):
    learned = store.read(path)
    mine = tmp_path / 'thesis.npz'
    mine.write_text('three years of work')
    (tmp_path / 'link.npz').symlink_to(mine)
    os.mkfifo(tmp_path / 'pipe.npz')
    for name, reason in (('thesis', 'is not a file of learned'), ('link', 'no regular file'), ('pipe', 'no regular')):
        with pytest.raises(LearningError, match=reason):
            store.save(tmp_path / f'{name}.npz', learned)
    assert mine.read_text() == 'three years of work'
    store.save(path, learned)  # one of ours
    assert sorted(each.name for each in tmp_path.iterdir()) == ['learned.npz', 'link.npz', 'pipe.npz', 'thesis.npz']


def test_damaged_file_is_refused_in_one_line(path):
    """Cut anywhere, or with any byte changed, it is refused or gives what was saved."""
    whole, draw = path.read_bytes(), np.random.default_rng(1)
    saved = store.read(path).feedforward
    damaged = [whole[: draw.integers(len(whole))] for _ in range(40)]
    damaged += [
        whole[:place] + bytes([whole[place] ^ 1 << draw.integers(8)]) + whole[place + 1 :]
        for place in draw.integers(len(whole), size=200)
    ]
    refusals = []
    for data in damaged:
        path.write_bytes(data)
        try:
            np.testing.assert_array_equal(store.read(path).feedforward, saved)
        except LearningError as refusal:
            refusals.append(str(refusal))
    assert len(refusals) > 100
    assert all(len(refusal.splitlines()) == 1 for refusal in refusals)


def test_file_that_unpacks_to_gigabytes_is_refused(path):
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive, archive.open('feedforward.npy', 'w') as file:
        for _ in range(110):
            file.write(bytes(1_000_000))
    with pytest.raises(LearningError, match='unpacks to 110 MB; allowed 100 MB'):
        store.read(path)


@pytest.mark.parametrize('volts', [9.0, 1e300])
def test_feedforward_beyond_the_voltage_limit_is_refused(tmp_path, volts):
    feedforward = np.full(TRAJECTORY.position.shape, 1.0)
    feedforward[7, 0] = -2.0 * volts
    store.save(tmp_path / 'x.npz', store.Learned(ORIGIN, feedforward, {}))
    with pytest.raises(LearningError, match=r'x\.npz: feedforward of .* V; allowed 10 V'):
        first_feedforward(tmp_path / 'x.npz', MACHINE, 'planar_80ms', 'inverse', GAINS, TRAJECTORY)


def test_absent_forces_do_not_change_the_design_hash():
    """Feedforward stored before models had the section `forces` stays valid."""
    text = [MACHINE.config.model_dump_json()]
    for kind, of_joints in (('control', GAINS), ('model', load_model(MACHINE))):
        text += [f'{kind} {joint} {each.model_dump_json(exclude={"forces"})}' for joint, each in of_joints.items()]
    assert store.design_hash(MACHINE, GAINS) == hashlib.sha256('\n'.join(text).encode()).hexdigest()[:12]
