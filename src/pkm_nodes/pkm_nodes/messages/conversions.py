"""Conversion between messages and arrays."""

from array import array

import numpy as np
from builtin_interfaces.msg import Duration, Time

from pkm_core.errors import TrajectoryError
from pkm_core.identification import IdentificationError
from pkm_core.motion.trajectory import DERIVATIVES, SampledTrajectory
from pkm_interfaces.action import Identify
from pkm_interfaces.msg import AxisFit, AxisResponse
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage

# field `kind` of a goal of identify by the `kind` of a `Request`
_EXPERIMENTS = {'both': Identify.Goal.BOTH, 'low_frequency': Identify.Goal.LOW_FREQUENCY, 'sweep': Identify.Goal.SWEEP}


def time_of_tick(tick, sample_time):
    """Return the simulated time of `tick` as builtin_interfaces/Time."""
    nanoseconds = nanoseconds_of_tick(tick, sample_time)
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def seconds_of(time):
    """Return a builtin_interfaces/Time or Duration in seconds."""
    return time.sec + 1e-9 * time.nanosec


def duration_of(seconds):
    """Return `seconds`, negative ones too, as builtin_interfaces/Duration."""
    whole, nanoseconds = divmod(round(1e9 * seconds), 10**9)
    return Duration(sec=whole, nanosec=nanoseconds)


def nanoseconds_of_tick(tick, sample_time):
    """Return the simulated time of `tick` in whole nanoseconds."""
    return tick * round(sample_time * 1e9)


def nanoseconds_of_standstill(tick, sample_time):
    """
    Return the simulated time [ns] of a machine that stands before `tick`: half a tick before it, at power-up after.

    No tick has this time. A recorder separates a state at standstill from those of a cycle by it, see
    `pkm_core.recording.topics.is_at_standstill`.
    """
    return abs(2 * tick - 1) * round(sample_time * 1e9) // 2


def is_identification(message):
    """Return whether the cycle of a trajectory message is an experiment of identification."""
    return message.kind == SampledTrajectoryMessage.IDENTIFICATION


def learns(message):
    """Return whether the controllers learn from the cycle of a trajectory message."""
    return message.kind == SampledTrajectoryMessage.MOTION and message.learning_law != 'none'


def trajectory_to_msg(
    trajectory,
    *,
    cycle,
    motion,
    learning_law='none',
    kind=SampledTrajectoryMessage.MOTION,
    feedforward=None,
    planned='',
    geometry='',
    stay=False,
    offset=0,
    hold=0,
):
    """
    Return a trajectory as a message.

    Parameters
    ----------
    trajectory : SampledTrajectory
        Of `coordinates` of a pose or of joints.
    cycle : int
        [1] number of the cycle.
    motion, learning_law : str
        Names.
    kind : int
        MOTION or IDENTIFICATION of the message.
    feedforward : ndarray, shape (N, joints), optional
        [V] learned feedforward for the cycle; without it the controllers keep theirs.
    planned : str
        Digest of the planned positions, if `trajectory` has a correction learned at the tool.
    geometry : str
        Hash of the kinematics it was computed with, '' if it is not to be checked.
    stay : bool
        Whether the cycle may end elsewhere than where it begins.
    offset, hold : int
        [samples] of a piece of a jog, see `motion.jog.Piece`.

    """
    message = SampledTrajectoryMessage(
        cycle=cycle,
        kind=kind,
        motion=motion,
        learning_law=learning_law,
        planned=planned,
        geometry=geometry,
        stay=stay,
        offset=offset,
        hold=hold,
        sample_time=trajectory.sample_time,
        coordinates=list(trajectory.coordinates),
        move_starts=[int(i) for i in trajectory.move_starts],
        move_ends=[int(i) for i in trajectory.move_ends],
    )
    for name in DERIVATIVES:
        setattr(message, name, _doubles(getattr(trajectory, name)))
    if feedforward is not None:
        message.feedforward = _doubles(feedforward)
    return message


def feedforward_from_msg(message, shape):
    """
    Return the learned feedforward in a trajectory message as an array of `shape` (N, joints) [V], None without one.

    Raises
    ------
    TrajectoryError
        If it has another length, or a value is not finite.

    """
    if not message.feedforward:
        return None
    where, feedforward = f'trajectory of cycle {message.cycle}', np.array(message.feedforward)
    if feedforward.size != shape[0] * shape[1]:
        raise TrajectoryError(f'{where}: {feedforward.size} feedforward values; expected {shape[0]} x {shape[1]}')
    if not np.isfinite(feedforward).all():
        raise TrajectoryError(f'{where}: a feedforward value is not finite')
    return feedforward.reshape(shape)


def trajectory_from_msg(message, *, coordinates, sample_time):
    """
    Return the `SampledTrajectory` of a message.

    Raises
    ------
    TrajectoryError
        If `kind` is unknown, `coordinates` or `sample_time` [s] differ, the arrays have different lengths, or a value
        is not finite.

    """
    where = f'trajectory of cycle {message.cycle}'
    if message.kind not in (message.MOTION, message.IDENTIFICATION):
        raise TrajectoryError(f'{where}: kind is {message.kind}; allowed: 0 (MOTION), 1 (IDENTIFICATION)')
    if tuple(message.coordinates) != tuple(coordinates):
        raise TrajectoryError(f'{where}: has coordinates {list(message.coordinates)}; expected {list(coordinates)}')
    if message.sample_time != sample_time:
        raise TrajectoryError(f'{where}: has a sample time of {message.sample_time} s; expected {sample_time} s')
    columns, arrays = len(coordinates), {}
    for name in DERIVATIVES:
        values = np.frombuffer(getattr(message, name), dtype=float)
        if len(values) == 0 or len(values) % columns:
            raise TrajectoryError(f'{where}: {len(values)} {name} values; expected a multiple of {columns} columns')
        arrays[name] = values.reshape(-1, columns)
    try:
        return SampledTrajectory(
            sample_time=message.sample_time,
            coordinates=tuple(coordinates),
            move_starts=np.array(message.move_starts, dtype=int),
            move_ends=np.array(message.move_ends, dtype=int),
            **arrays,
        )
    except TrajectoryError as error:
        raise TrajectoryError(f'cycle {message.cycle}: {error}') from None


def experiments_to_msg(kind):
    """Return the field `kind` of a goal of identify for the `kind` of a `Request`; '' is 'both'."""
    return _EXPERIMENTS[kind or 'both']


def experiments_from_msg(number):
    """Return the `kind` of a `Request` for that of a goal of identify; `IdentificationError` if it is unknown."""
    for kind, known in _EXPERIMENTS.items():
        if number == known:
            return kind
    raise IdentificationError(f'identify: kind is {number}; allowed: 0 (BOTH), 1 (LOW_FREQUENCY), 2 (SWEEP)')


def fit_to_msg(found):
    """Return an `AxisIdentification` as a message."""
    low, high = found.low, found.high
    message = AxisFit(
        joint=found.joint,
        gain=low.gain,
        viscosity=low.viscosity,
        covariance=low.covariance.ravel(),
        fit_percent=low.fit_percent,
        response_fit_percent=found.high_percent,
        responses=[
            AxisResponse(
                name=response.name,
                position=response.position,
                frequency=_doubles(response.frequency),
                real=_doubles(response.plant.real),
                imag=_doubles(response.plant.imag),
                deviation=_doubles(response.deviation),
                coherence=_doubles(response.coherence),
            )
            for response in found.responses
        ],
    )
    if high is not None:
        names = ('resonance', 'resonance_damping', 'antiresonance', 'antiresonance_damping')
        for name, values in zip(names, high.modes.T, strict=True):
            setattr(message, name, _doubles(values))
        message.mode_covariance = _doubles(high.covariance)
    return message


def _doubles(values):
    return array('d', np.ascontiguousarray(values, dtype=float).tobytes())
