"""A cell without ROS: it hands serialized messages to a `Recording` as the node `recorder` does."""

import resource
from contextlib import contextmanager
from itertools import groupby

import numpy as np

from pkm_core.bag.message_types import typestore
from pkm_core.machines import load_machine
from pkm_core.machines.laser_clock import sample_numbers
from pkm_core.recording.recording import Recording
from pkm_core.recording.topics import recorded_topics

JOINTS = ('d1', 'd3', 'd5', 'd7')
SAMPLES = 60
MACHINE = load_machine('four_dof')
TS = 5e-4
LASER_TS = 8e-4
EVENT = 'pkm_interfaces/msg/CycleEvent'


class Cell:
    """A cell without ROS whose messages arrive in order, one cycle after the other."""

    def __init__(self, folder, preroll=1.0):
        self.topics = {f'/pkm/{topic.name}': topic for topic in recorded_topics(JOINTS) if topic.name[0] != '/'}
        self.warnings, self.offered = [], set(self.topics)
        facts = {'machine': 'four_dof', 'git_revision': '0123abc'}
        self.recording = Recording(
            folder,
            self.topics,
            MACHINE,
            preroll,
            lambda motion, law: facts | {'asked': motion + law},
            self.warnings.append,
            lambda topic: topic in self.offered,
        )
        self._types = typestore()

    def say(self, topic, **fields):
        kind = self.topics[f'/pkm/{topic}'].kind
        types = self._types.types
        self.deliver(topic, bytes(self._types.serialize_cdr(types[kind](**fields), kind)))

    def deliver(self, topic, data):
        self.recording.takers[f'/pkm/{topic}'](data)

    def tell(self, event, cycle, tick=0, samples=SAMPLES, message=''):
        number = getattr(self._types.types[EVENT], event)
        fields = {'source': 'machine', 'cycle': cycle, 'tick': tick, 'samples': samples, 'bag': '', 'message': message}
        fields |= {'session': '', 'hold': 0}
        self.say('cycle_events', event=number, **fields)

    def load(self, cycle, motion='short', *, samples=SAMPLES, offset=0, hold=0, position=0.0):
        """Send both trajectories, or with an `offset` a piece of a jog; they rest at `position`."""
        values = {name: np.zeros(4 * samples) for name in ('velocity', 'acceleration', 'jerk')}
        values['position'] = np.full(4 * samples, position)
        moves = {'move_starts': np.array([0], dtype=np.uint32), 'move_ends': np.array([1], dtype=np.uint32)}
        for topic in ('pose', 'joint'):
            self.say(
                f'{topic}_trajectory',
                **{
                    'cycle': cycle,
                    'kind': 0,
                    'motion': motion,
                    'learning_law': 'fourier',
                    'sample_time': TS,
                    'planned': '',
                    'stay': False,
                    'offset': offset,
                    'hold': hold,
                },
                coordinates=list(JOINTS),
                **values,
                **moves,
                feedforward=np.zeros(0),
                geometry='',
            )

    def tick(self, cycle, tick, index, without=(), feedforward=0.0, mode=0):
        for joint in JOINTS:
            same = {'tick': tick, 'cycle': cycle}
            if f'{joint}/encoder' not in without:
                self.say(f'{joint}/encoder', **same, index=index, mode=mode, counts=tick, position=0.0)
            if f'{joint}/command' not in without:
                self.say(f'{joint}/command', **same, voltage=1.0, error=0.0, feedforward=feedforward)
        if tick % 20 == 0:
            self.states(tick)
        for number in sample_numbers(MACHINE, tick, tick + 1):
            self.say('laser', time=number * LASER_TS, displacement=np.zeros(4))

    def states(self, tick):
        types = self._types.types
        nanoseconds = round(tick * TS * 1e9)
        stamp = types['builtin_interfaces/msg/Time'](sec=0, nanosec=nanoseconds)
        header = types['std_msgs/msg/Header'](stamp=stamp, frame_id='base')
        point, turn = types['geometry_msgs/msg/Point'](x=0.0, y=0.0, z=0.0), {'x': 0.0, 'y': 0.0, 'z': 0.0, 'w': 1.0}
        pose = types['geometry_msgs/msg/Pose'](
            position=point, orientation=types['geometry_msgs/msg/Quaternion'](**turn)
        )
        self.say('pose', header=header, pose=pose)
        none = np.zeros(0)
        self.say('joint_states', header=header, name=[], position=none, velocity=none, effort=none)

    def run(self, cycle, first, *, without=None, feedforward=lambda index: 0.0, end=SAMPLES):
        """Run `cycle` from tick `first`; `without` names, by index, the topics without a message."""
        self.tell('STARTED', cycle, first)
        for index in range(end):
            self.tick(cycle, first + index, index, (without or {}).get(index, ()), feedforward(index))
        self.recording.sort()

    def finish(self, cycle, end):
        for joint in JOINTS:
            values = {'max_dynamic_error': 0.0, 'settling_time_5um': 0.0, 'settling_time_1um': 0.0}
            self.say(f'{joint}/cycle_metrics', cycle=cycle, joint=joint, **values, steady_state_error=0.0)
        self.tell('FINISHED', cycle, end)

    def play(self, cycle, first, **options):
        self.load(cycle)
        self.run(cycle, first, **options)
        self.finish(cycle, first + SAMPLES)

    def outcome(self):
        """Return the only outcome and remove it."""
        [outcome] = self.recording.outcomes
        self.recording.outcomes.clear()
        return outcome


class SlowCell(Cell):
    """A cell whose messages arrive late, topic by topic, those of the servo tick first."""

    def __init__(self, folder):
        super().__init__(folder)
        self._late = {topic.removeprefix('/pkm/'): [] for topic in self.topics}

    def deliver(self, topic, data):
        self._late[topic].append(data)

    def arrive(self):
        for topic, messages in self._late.items():
            for size, alike in groupby(messages, key=len):
                super().deliver(topic, np.frombuffer(b''.join(alike), np.uint8).reshape(-1, size))
            messages.clear()
        self.recording.sort()


@contextmanager
def no_file_beyond(size):
    """Limit every file of this process to `size` [bytes]: writes beyond it fail as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
