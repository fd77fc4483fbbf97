"""
Identification experiments of one axis, thesis 7.3.2 and 8.3.2, checked before they run.

Low frequency: rest-to-rest moves there and back, spread over the travel because thrust varies along the magnets.
High frequency: a swept sine added to the controller's voltage during a jog. The jog is faster than the vibration, so
the slider never stops and friction is constant; at standstill friction changes the response by up to a factor of two.
The sweep is periodic: whole periods leave no leakage.
"""

from dataclasses import dataclass

import numpy as np

from pkm_core.control.feasibility import drive_limit
from pkm_core.identification import IdentificationError
from pkm_core.identification.axis_data import joint_number
from pkm_core.identification.guard import Bounds
from pkm_core.identification.path import Path
from pkm_core.identification.sweep import Sweep, forecast, one_period
from pkm_core.motion.trajectory import SampledTrajectory, checked_joints

# (length [m], duration [s]) of the thesis's slow moves by mechanism and joint
_MOVES = {
    'planar': {'d1': (10e-3, 70e-3), 'd3': (10e-3, 80e-3)},
    'four_dof': {'d1': (5e-3, 70e-3), 'd3': (5e-3, 70e-3), 'd5': (4e-3, 70e-3), 'd7': (4e-3, 70e-3)},
}
_OTHER_MOVES = (5e-3, 70e-3)
_PAIRS = (('d1', 'd3'), ('d5', 'd7'))  # motors on one guide; a common shift leaves the inertia nearly unchanged
_TRANSFER = 0.2  # s, to and from a station
_SETTLED = 0.05  # s, after a transfer
_REST = 0.03  # s, after a slow move
_TURN = 0.05  # s, from rest to the speed of the jog
_CLEARANCE = 0.5e-3  # m, kept from the ends of the travel


@dataclass(frozen=True)
class Experiment:
    """One cycle of excitation, from home to home; runs in the simulation or in the cell."""

    name: str
    joint: str
    trajectory: SampledTrajectory  # of all joints
    excitation: np.ndarray  # (N, n) [V], to be added to the controllers' voltages
    bounds: Bounds  # of `joint` during the cycle


def experiments(machine, joint, models, gains, sweep=None):
    """Return every `Experiment` for `joint`; `models` and `gains` are those of all joints."""
    joint_number(machine, joint)
    return [
        slow_moves(machine, joint, models[joint]),
        *sweeps(machine, joint, models[joint], gains[joint], sweep),
    ]


def slow_moves(machine, joint, model, *, stroke=0.0, stations=5):
    """
    Return the `Experiment` for L: the thesis's move there and back, twice, at `stations` positions of the motor pair.

    `model` is the present model of the axis; only the voltage forecast uses it. A `stroke` [m] other than 0 replaces
    the length of the thesis's move, not its duration.
    """
    own, pair = _directions(machine, joint)
    usual, duration = _MOVES.get(machine.config.mechanism, {}).get(joint, _OTHER_MOVES)
    length = stroke or usual
    path = Path(machine)
    path.rest(_SETTLED)
    for shift in _stations(machine, own, pair, 0.5 * length, stations):
        start = machine.home + shift * pair - 0.5 * length * own
        path.move(start, _TRANSFER)
        path.rest(2 * _SETTLED)
        for _ in range(2):
            for target in (start + length * own, start):
                path.move(target, duration, listed=True)
                path.rest(_REST)
    path.move(machine.home, _TRANSFER)
    path.rest(_SETTLED)
    return _checked(machine, 'slow_moves', joint, path, model)


def sweeps(machine, joint, model, gains, sweep=None, stations=3):
    """
    Return one `Experiment` for H per position of the motor pair: a jog there and back with a superimposed sweep.

    Parameters
    ----------
    machine : Machine
        Machine of the joint.
    joint : str
        Joint to excite.
    model : AxisModel
        Present model of the joint; scales the amplitude so that the vibration stays slower than the jog.
    gains : RobustGains
        Gains of the joint during the sweep.
    sweep : Sweep, optional
        Settings of the swept sine.
    stations : int
        Number of positions, spread over the travel.

    Raises
    ------
    IdentificationError
        If `one_period` refuses the sweep, or the axis would exceed its travel, speed or voltage.

    """
    sweep = sweep or Sweep()
    own, pair = _directions(machine, joint)
    try:
        one = one_period(sweep, model, gains, machine.sample_time, drive_limit(machine))
    except IdentificationError as error:
        raise IdentificationError(f'{joint}: {error}') from None
    duration = sweep.settling + sweep.periods * len(one) * machine.sample_time
    half, speed = 0.5 * sweep.speed * (duration + _TURN), sweep.speed * own
    experiments = []
    for number, shift in enumerate(_stations(machine, own, pair, half, stations)):
        path = Path(machine)
        path.rest(_SETTLED)
        path.move(machine.home + shift * pair - half * own, _TRANSFER)
        path.rest(_SETTLED)
        path.change_speed(0 * speed, speed, _TURN)
        passes = [path.cruise(speed, duration)]
        path.change_speed(speed, -speed, 2 * _TURN)
        passes.append(path.cruise(-speed, duration))
        path.change_speed(-speed, 0 * speed, _TURN)
        path.rest(_REST)
        path.move(machine.home, _TRANSFER)
        path.rest(_SETTLED)
        volts = np.zeros(path.samples)
        for start, end in passes:
            volts[start:end] = np.resize(one, end - start)
        experiments.append(_checked(machine, f'sweep_{number}', joint, path, model, gains, volts))
    return experiments


def _directions(machine, joint):
    """Return, over all joints, the directions of `joint` alone and of its motor pair."""
    joint_number(machine, joint)
    partners = next((pair for pair in _PAIRS if joint in pair), (joint,))
    return (np.array([float(name in names) for name in machine.joints]) for names in ((joint,), partners))


def _stations(machine, own, pair, half, count):
    """Return `count` shifts [m] of the motor pair, over all of the travel that a stroke of +-`half` [m] leaves."""
    room = np.minimum(machine.home - machine.limits.lower, machine.limits.upper - machine.home) - half * own
    reach = room[pair > 0].min() - _CLEARANCE
    if reach < 0:
        raise IdentificationError(
            f'{machine.joints[own.argmax()]}: a stroke of {2e3 * half:.1f} mm leaves the travel; allowed '
            f'{2e3 * (reach + half):.1f} mm, {1e3 * _CLEARANCE:g} mm off either end'
        )
    return np.linspace(-reach, reach, count) if count > 1 else np.zeros(1)


def _checked(machine, name, joint, path, model, gains=None, volts=None):
    """Return the `Experiment` of `path` with the excitation `volts` (N,) of `joint`; refuse one beyond its limits."""
    trajectory = checked_joints(machine, path.trajectory())
    machine.forward(trajectory.position)  # refuses positions out of reach of the links
    axis = machine.joints.index(joint)
    velocity, excitation = trajectory.velocity[:, axis], np.zeros_like(trajectory.position)
    needed = np.abs(trajectory.acceleration[:, axis] + model.viscosity * velocity) / model.gain
    speed = np.abs(velocity)
    if volts is not None:
        excitation[:, axis] = volts
        added, shaken = forecast(model, gains, volts, machine.sample_time)
        needed, speed = needed + np.abs(added), speed + np.abs(shaken)
    peak, fastest, limit = float(needed.max()), float(speed.max()), drive_limit(machine)
    if peak > limit:
        raise IdentificationError(
            f'{name}: {joint} would need {peak:.1f} V ({peak * machine.thrust_per_volt:.0f} N); allowed {limit:g} V '
            f'({limit * machine.thrust_per_volt:.0f} N)'
        )
    if fastest > machine.limits.speed:
        raise IdentificationError(
            f'{name}: {joint} would move at {fastest:.3f} m/s; allowed {machine.limits.speed:g} m/s'
        )
    bounds = Bounds.around(machine, joint, peak, fastest)
    return Experiment(f'{joint}_{name}', joint, trajectory, excitation, bounds)
