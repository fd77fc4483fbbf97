"""Recorded cycles without a cell: what a recorder would have written, from arrays."""

import json
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from pkm_core.bag.message_types import typestore
from pkm_core.bag.writer import BagWriter
from pkm_core.machines import load_machine
from pkm_core.motion.planning import Motion, Target, plan
from pkm_core.motion.trajectory import DERIVATIVES, to_joints

TYPES = {
    'encoder': 'pkm_interfaces/msg/EncoderSample',
    'command': 'pkm_interfaces/msg/MotorCommand',
    'trajectory': 'pkm_interfaces/msg/SampledTrajectory',
    'pose': 'geometry_msgs/msg/PoseStamped',
    'cycle_events': 'pkm_interfaces/msg/CycleEvent',
    'laser': 'pkm_interfaces/msg/LaserSample',
}
NANOSECONDS = 500_000  # of a tick
# fields that messages of older bags do not have, see test_bag_of_an_older_version_is_read
_NEWER = {'stay': False, 'kind': 0, 'bag': '', 'session': '', 'planned': '', 'geometry': '', 'offset': 0, 'hold': 0}


@dataclass
class RecordedCycle:
    """A cycle of two moves of 2 mm on `machine`, and what happened in it."""

    machine: object
    poses: object  # SampledTrajectory
    joints: object
    error: np.ndarray  # (N, n) [m]
    voltage: np.ndarray  # (N, n) [V]


@cache
def trajectories(name):
    machine = load_machine(name)
    by = dict.fromkeys(machine.joints, 2e-3)
    motion = Motion(machine=name, targets=[Target(by=by)], lead_rest=10e-3, move_time=40e-3, settle_window=50e-3)
    poses = plan(machine, motion)
    return machine, poses, to_joints(machine, poses)


def recorded_cycle(name='four_dof', amplitude=10e-6, offset=0.0):
    """Return a cycle whose error [m] is an 80 Hz sine of `amplitude` while moving, decaying after, plus `offset`."""
    machine, poses, joints = trajectories(name)
    time = np.arange(len(joints)) * joints.sample_time
    envelope = np.zeros(len(joints))
    for start, end in zip(joints.move_starts, joints.move_ends, strict=True):
        envelope[start:end] = 1.0
        envelope[end:] = np.exp(-(time[end:] - time[end]) / 5e-3)
    wave = amplitude * envelope * np.sin(2 * np.pi * 80.0 * time) + offset
    scale = 1.0 + np.arange(len(machine.joints))
    measured = joints.position - np.outer(wave, scale)  # rounded; the error is what a reader will find
    return RecordedCycle(machine, poses, joints, joints.position - measured, np.outer(wave * 1e5, scale))


class Recording:
    """A bag under way; `tick` by `tick`, then `close`, or not."""

    def __init__(
        self,
        folder,
        cycle,
        number,
        *,
        law='fourier',
        motion='short',
        first_tick=0,
        metadata=None,
        laser=False,
        types=None,
    ):
        self.cycle, self.number, self.first = cycle, number, first_tick
        self._store = types or typestore()
        topics = {'/pkm/pose_trajectory': TYPES['trajectory'], '/pkm/joint_trajectory': TYPES['trajectory']}
        for joint in cycle.machine.joints:
            topics |= {f'/pkm/{joint}/{kind}': TYPES[kind] for kind in ('encoder', 'command')}
        topics |= {f'/pkm/{kind}': TYPES[kind] for kind in ('pose', 'cycle_events')}
        if laser:
            topics['/pkm/laser'] = TYPES['laser']
        self._topics = topics
        name = f'{motion}_{number:04d}'
        self.bag = BagWriter(Path(folder) / name, topics, metadata or {'motion': motion}, self._store)
        for topic, trajectory in (('pose', cycle.poses), ('joint', cycle.joints)):
            self._put(
                f'/pkm/{topic}_trajectory',
                0,
                cycle=number,
                motion=motion,
                learning_law=law,
                sample_time=trajectory.sample_time,
                coordinates=list(trajectory.coordinates),
                move_starts=trajectory.move_starts.astype(np.uint32),
                move_ends=trajectory.move_ends.astype(np.uint32),
                feedforward=np.zeros(0),
                **{name: np.ravel(getattr(trajectory, name)) for name in DERIVATIVES},
            )

    def _put(self, topic, index, /, **fields):
        kind = self._topics[topic]
        message = self._store.types[kind]
        newer = {name: value for name, value in _NEWER.items() if name in message.__dataclass_fields__}
        data = self._store.serialize_cdr(message(**newer, **fields), kind)
        self.bag.write(topic, bytes(data), (self.first + index) * NANOSECONDS)

    def tick(self, index, without=()):
        """Write the messages of one tick of all joints but those named."""
        cycle, tick = self.cycle, self.first + index
        for i, joint in enumerate(cycle.machine.joints):
            if joint in without:
                continue
            position = cycle.joints.position[index, i] - cycle.error[index, i]
            counts = round(position / cycle.machine.encoder_resolution)
            same = {'tick': tick, 'cycle': self.number}
            self._put(f'/pkm/{joint}/encoder', index, **same, index=index, mode=0, counts=counts, position=position)
            # what a controller says of its error counts for nothing
            answer = {'voltage': cycle.voltage[index, i], 'error': np.nan, 'feedforward': 0.0}
            self._put(f'/pkm/{joint}/command', index, **same, **answer)

    def ticks(self, count=None):
        """Write the messages of the first `count` ticks, or of all."""
        for index in range(count or len(self.cycle.joints)):
            self.tick(index)

    def event(self, event, index):
        """Write a cycle event."""
        same = {'cycle': self.number, 'tick': self.first + index, 'samples': index}
        self._put('/pkm/cycle_events', index, event=event, source='test', message='', **same)

    def laser(self, time, displacement):
        """Write a laser sample of `time` [s] from the first tick."""
        tick = round(time / self.cycle.joints.sample_time)
        sample = {'time': time + self.first * self.cycle.joints.sample_time, 'displacement': np.array(displacement)}
        self._put('/pkm/laser', tick, **sample)

    def close(self):
        """Finish the bag and return its folder."""
        expected = {topic: len(self.cycle.joints) for topic in self._topics if topic.endswith(('encoder', 'command'))}
        self.bag.close({'expected': json.dumps(expected)})
        return self.bag.path


@pytest.fixture(scope='session')
def make_cycle():
    """Return `recorded_cycle`."""
    return recorded_cycle


@pytest.fixture(scope='session')
def start_recording_in():
    """Return a function that starts a `Recording` in a folder."""

    def start(folder, cycle=None, number=1, **options):
        return Recording(folder, cycle or recorded_cycle(), number, **options)

    return start


@pytest.fixture
def start_recording(tmp_path, start_recording_in):
    """Return a function that starts a `Recording` in the test's folder."""
    return partial(start_recording_in, tmp_path)


@pytest.fixture
def write_bag(start_recording):
    """Return a function that writes the whole bag of a cycle and returns its folder."""

    def write(cycle=None, number=1, **options):
        recording = start_recording(cycle, number, **options)
        recording.ticks()
        return recording.close()

    return write
