"""The recorded topics of a cell, and the field by which a message is assigned to a cycle."""

from enum import Enum
from typing import NamedTuple

from pkm_core.machines.laser_clock import sample_numbers

# [ticks] period of the machine's states: 100 Hz of simulated time
STATES_EVERY = 20


class By(Enum):
    """How messages of a topic are assigned to a cycle."""

    TICK = 'its fields tick and cycle'
    CYCLE = 'its field cycle'
    STAMP = 'a stamp'
    TIME = 'its field time [s], simulated'
    TRAJECTORY = 'its field cycle; the last message of each topic is recorded, and all pieces of a jog'
    EVENT = 'its field cycle; starts and ends cycles'
    ARRIVAL = 'the cycle that runs when the message arrives'


class RecordedTopic(NamedTuple):
    """One topic of the cell."""

    name: str  # relative to the namespace of the cell, or absolute
    kind: str  # message type
    by: By
    stamp: str = 'header.stamp'  # path of the stamp in a message that is sorted by it
    optional: bool = False  # a cell is complete without it: replacements of nodes need not publish it


def is_at_standstill(nanoseconds, tick):
    """
    Return whether a stamp [ns], number or array, is between two ticks of `tick` [ns]: of a machine that stands.

    Such states are published between cycles, in wall time, and belong to none.
    """
    return nanoseconds % tick == tick // 2


def recorded_topics(joints):
    """Return the `RecordedTopic`s of a cell with `joints`."""
    per_joint = [
        topic
        for joint in joints
        for topic in (
            RecordedTopic(f'{joint}/encoder', 'pkm_interfaces/msg/EncoderSample', By.TICK),
            RecordedTopic(f'{joint}/command', 'pkm_interfaces/msg/MotorCommand', By.TICK),
            RecordedTopic(f'{joint}/cycle_metrics', 'pkm_interfaces/msg/CycleMetrics', By.CYCLE, optional=True),
        )
    ]
    return [
        *per_joint,
        RecordedTopic('pose_trajectory', 'pkm_interfaces/msg/SampledTrajectory', By.TRAJECTORY),
        RecordedTopic('joint_trajectory', 'pkm_interfaces/msg/SampledTrajectory', By.TRAJECTORY),
        RecordedTopic('excitation', 'pkm_interfaces/msg/Excitation', By.CYCLE),
        RecordedTopic('pose', 'geometry_msgs/msg/PoseStamped', By.STAMP),
        RecordedTopic('twist', 'geometry_msgs/msg/TwistStamped', By.STAMP),
        RecordedTopic('joint_states', 'sensor_msgs/msg/JointState', By.STAMP),
        RecordedTopic('markers', 'visualization_msgs/msg/MarkerArray', By.STAMP, stamp='markers.0.header.stamp'),
        RecordedTopic('laser', 'pkm_interfaces/msg/LaserSample', By.TIME, optional=True),
        RecordedTopic('cycle_events', 'pkm_interfaces/msg/CycleEvent', By.EVENT),
        RecordedTopic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', By.ARRIVAL),
    ]


def expected_messages(topics, machine, cycle, event, finished):
    """
    Return how many messages a cycle must have, from the event by which the machine ended it.

    Parameters
    ----------
    topics : dict of str to RecordedTopic
        By resolved name; the topics that have a publisher.
    machine : Machine
        For the sample time of its laser.
    cycle : CycleRecording
        Its first tick is known.
    event : CycleEvent
        FINISHED or FAULT of the machine.
    finished : bool
        Which of them.

    Returns
    -------
    counts : dict of str to int
        By topic; without the topics of which the number is not fixed by the cycle.

    """
    states = _states(cycle.first_tick, event.tick)
    counts = {
        'pkm_interfaces/msg/EncoderSample': event.tick - cycle.first_tick,
        'pkm_interfaces/msg/MotorCommand': event.samples,
        'pkm_interfaces/msg/CycleMetrics': int(finished),
        'pkm_interfaces/msg/SampledTrajectory': 1 + cycle.extensions,
        'geometry_msgs/msg/PoseStamped': states,
        'sensor_msgs/msg/JointState': states,
        'pkm_interfaces/msg/LaserSample': len(sample_numbers(machine, cycle.first_tick, event.tick)),
    }
    due = {name: counts[topic.kind] for name, topic in topics.items() if topic.kind in counts}
    # a piece of a jog that was not driven is in the bag if it arrived before the end
    return {n: max(count, cycle.counts[n]) if topics[n].by is By.TRAJECTORY else count for n, count in due.items()}


def expected_without_end(topics, machine, cycle):
    """
    Return how many messages a cycle without an end event must have at least, by the encoder samples in its bag.

    A tick of all encoders has its states and the commands of the ticks before it. The parameters and the result are
    those of `expected_messages`; no count is below what is in the bag.
    """
    first, reached = cycle.first_tick, cycle.reached()
    encoders = [reached[name] for name, topic in topics.items() if topic.kind == 'pkm_interfaces/msg/EncoderSample']
    last, whole = max(encoders), min(encoders)
    states = _states(first, whole + 1)
    due = sample_numbers(
        machine, first, max(first, whole - whole % STATES_EVERY)
    )  # read by the machine with the states
    counts = {
        'pkm_interfaces/msg/EncoderSample': last + 1 - first,
        'pkm_interfaces/msg/MotorCommand': max(0, last - first),
        'pkm_interfaces/msg/SampledTrajectory': 1 + cycle.extensions,
        'geometry_msgs/msg/PoseStamped': states,
        'sensor_msgs/msg/JointState': states,
        'pkm_interfaces/msg/LaserSample': len(due),
    }
    return {n: max(cycle.counts[n], counts[topic.kind]) for n, topic in topics.items() if topic.kind in counts}


def _states(first, end):
    """Return the number of states of the ticks from `first` up to `end`, which is not among them."""
    return sum(tick % STATES_EVERY == 0 for tick in range(first, end))
