"""What is recorded of a cell, and how a message tells which cycle it belongs to."""

from enum import Enum
from typing import NamedTuple

from pkm_core.machines.laser_clock import sample_numbers

# [ticks] states of the machine go out at 100 Hz of simulated time
STATES_EVERY = 20


class By(Enum):
    """What a message is sorted by."""

    TICK = 'tick and cycle, its first fields'
    CYCLE = 'cycle, its first field'
    STAMP = 'the stamp of its header'
    TIME = 'the simulated time [s], its first field'
    TRAJECTORY = 'cycle; the last of each topic counts'
    EVENT = 'cycle; the story of it'
    ARRIVAL = 'the cycle that runs when it comes'


class RecordedTopic(NamedTuple):
    """One topic of the cell."""

    name: str  # relative to the namespace of the cell, or absolute
    kind: str  # message type
    by: By
    stamp_at: int = 4  # [bytes] where the stamp is in a serialized message, if it is sorted by that
    optional: bool = False  # whether a cell may do without: others in the place of our nodes need not have it


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
        # an array: the stamp of its first marker comes after the length
        RecordedTopic('markers', 'visualization_msgs/msg/MarkerArray', By.STAMP, stamp_at=8),
        RecordedTopic('laser', 'pkm_interfaces/msg/LaserSample', By.TIME, optional=True),
        RecordedTopic('cycle_events', 'pkm_interfaces/msg/CycleEvent', By.EVENT),
        RecordedTopic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', By.ARRIVAL),
    ]


def expected_messages(topics, machine, cycle, event, finished):
    """
    Return how many messages a cycle must have, from the machine's own account of its end.

    Parameters
    ----------
    topics : dict of str to RecordedTopic
        By resolved name; those that are offered.
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
        By topic; one of which nobody can say the number is not among them.

    """
    states = sum(tick % STATES_EVERY == 0 for tick in range(cycle.first_tick, event.tick))
    counts = {
        'pkm_interfaces/msg/EncoderSample': event.tick - cycle.first_tick,
        'pkm_interfaces/msg/MotorCommand': event.samples,
        'pkm_interfaces/msg/CycleMetrics': int(finished),
        'pkm_interfaces/msg/SampledTrajectory': 1,
        'geometry_msgs/msg/PoseStamped': states,
        'sensor_msgs/msg/JointState': states,
        'pkm_interfaces/msg/LaserSample': len(sample_numbers(machine, cycle.first_tick, event.tick)),
    }
    return {name: counts[topic.kind] for name, topic in topics.items() if topic.kind in counts}
