"""
Steps of a calibration in a running cell that need no ROS: plan, fit and check. They run in a worker process. The
node that submits them starts without scipy.

The poses of the fit and those of the verification are visited in the same cycles. A calibration is accepted if it
predicts the verification poses better than the geometry in use. After it has been taken up, the verification poses are
commanded again: the laser must find them nearer to where they were commanded than the first time.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pkm_core.design.calibration import Calibration, calibrate, prediction_errors
from pkm_core.design.calibration_file import write_calibrated_machine
from pkm_core.design.calibration_motion import AVERAGED, MOVE_TIME, REST, calibration_motion
from pkm_core.design.calibration_study import CalibrationStudy
from pkm_core.design.information import weakest_direction
from pkm_core.design.measurement import load_laser, write_measurements
from pkm_core.design.pose_plan import plan_poses, spread_poses
from pkm_core.design.tolerances import load_tolerances
from pkm_core.design.verification import FEWEST_HELD, Verification, verify
from pkm_core.errors import PkmError
from pkm_core.files import refused_if_unwritable, writable_folder
from pkm_core.machines.base import Machine

POSES = 20
VERIFICATION = 8
WAIT = REST - AVERAGED  # [s]
_MOST_VERIFICATION = 200
_LONGEST = 5.0  # [s] of a wait or an average


@dataclass(frozen=True)
class Request:
    """Settings of a calibration; zeros, as in an empty ROS goal, take the defaults. Bad values raise a `PkmError`."""

    poses: int = 0  # of the fit
    verification: int = 0  # other poses
    wait: float = 0.0  # [s] at rest before an average
    averaging: float = 0.0  # [s]
    seed: int = 0  # of the plan

    def __post_init__(self):
        defaults = {'poses': POSES, 'verification': VERIFICATION, 'wait': WAIT, 'averaging': AVERAGED}
        for name, default in defaults.items():
            object.__setattr__(self, name, getattr(self, name) or default)
        for name in ('wait', 'averaging'):
            value = getattr(self, name)
            if not (math.isfinite(value) and 0.0 < value <= _LONGEST):
                raise PkmError(f'calibrate: {name} is {value} s; allowed above 0 to {_LONGEST:g} s')
        if not FEWEST_HELD <= self.verification <= _MOST_VERIFICATION:
            raise PkmError(
                f'calibrate: {self.verification} poses of verification; allowed {FEWEST_HELD} to {_MOST_VERIFICATION}'
            )

    @property
    def rest(self):
        """Rest at each pose [s]."""
        return self.wait + self.averaging


def plan_cycles(machine, request):
    """
    Return the poses of each cycle, a list of (k, m) [m, rad]: those of the fit, then those of the verification.

    `PkmError` if the poses are too few or cannot be visited.
    """
    chosen = plan_poses(machine, request.poses, request.seed, load_tolerances(), load_laser())
    return _cycles(machine, np.vstack([chosen, verification_poses(machine, request)]), request)


def check_cycles(machine, request):
    """Return the poses of each cycle that visits those of the verification again, as `plan_cycles` does."""
    return _cycles(machine, verification_poses(machine, request), request)


def verification_poses(machine, request):
    """Return the poses (verification, m) [m, rad] of the verification."""
    return spread_poses(machine, request.verification, request.seed + 1)


def _cycles(machine, poses, request):
    times = {'move_time': MOVE_TIME, 'rest': request.rest, 'averaged': request.averaging}
    return [cycle.poses for cycle in calibration_motion(machine, poses, **times)]


@dataclass(frozen=True)
class CellCalibration:
    """Result of a fit in a cell."""

    calibration: Calibration
    verification: Verification
    commanded: np.ndarray  # (verification, m) [m, rad] less the mean: laser minus commanded poses
    weakest: str  # least known direction, in words
    machine: Machine  # in use before
    file: Path  # calibrated machine file

    @property
    def noise(self):
        """Standard deviation (m,) of an average [m, rad]."""
        return self.verification.noise


def measure(machine, bags, namespace, averaging):
    """Return the `Measurements` of the rests in `bags`, one per cycle, in order."""
    from pkm_core.design.rest_bags import rests_from_bag
    from pkm_core.design.rests import joined

    laser = load_laser()
    return joined([rests_from_bag(bag, machine, laser, namespace=namespace, averaged=averaging) for bag in bags])


def fit_bags(machine, machine_name, bags, namespace, request, file):
    """
    Fit the machine of a cell from the `bags` of `plan_cycles`, write its files and return the `CellCalibration`.

    Parameters
    ----------
    machine : Machine
        In use during the cycles.
    machine_name : str
        Name or file of the machine that the cell was started with: what the calibrated file is a copy of.
    bags : list of Path
        One per cycle.
    namespace : str
        Of the cell.
    request : Request
        Numbers of poses, and the average.
    file : Path
        Gets the calibrated machine; measurements and a figure are written beside it.

    Raises
    ------
    PkmError
        If a bag is refused, the misfit is too large, or a file cannot be written.

    """
    seen = measure(machine, bags, namespace, request.averaging)
    expected = request.poses + request.verification
    if len(seen.q) != expected:
        raise PkmError(f'{Path(bags[0]).parent}: {len(seen.q)} rests in {len(bags)} bags; expected {expected}')
    return fit_measurements(machine, machine_name, seen, request, file, f'{len(bags)} cycles of a cell')


def fit_measurements(machine, machine_name, seen, request, file, source):
    """Do what `fit_bags` does with the `Measurements` `seen` of all poses; the text `source` names their origin."""
    from pkm_core.design.calibration_figures import draw_calibration

    used, held = seen.rows(slice(request.poses)), seen.rows(slice(request.poses, None))
    tolerances, noise = load_tolerances(), seen.noise(machine, load_laser())
    found = calibrate(machine, used, tolerances, noise)
    before, after = (prediction_errors(each.forward, held) for each in (machine, found.machine))
    verification = verify(machine, found.machine, held, noise)
    value, parts = weakest_direction(machine.drawing, used.q, tolerances, noise)
    mix = ' '.join(f'{part:+.2f} {name}' for name, part in parts.items() if abs(part) > 0.2)
    folder = writable_folder(file.parent)
    with refused_if_unwritable(folder):
        write_measurements(folder / 'measurements.csv', machine, seen)
        write_calibrated_machine(file, machine_name, found, source, machine.configuration)
        draw_calibration(folder, CalibrationStudy(found, used, held, noise, before, after, verification))
    errors = positioning(held, verification_poses(machine, request))
    return CellCalibration(found, verification, errors, f'singular value {value:.2g}: {mix}', machine, file)


def positioning(measurements, commanded):
    """Return the displacements by laser minus the `commanded` poses (N, m) [m, rad], less their mean."""
    errors = measurements.displacement - commanded
    return errors - errors.mean(axis=0)


def check_bags(fitted, bags, namespace, request):
    """
    Return the `Verification` of the calibrated geometry in use, from the bags of its verification poses.

    Its errors are those of the laser against the commanded poses, before: at the first visit.
    """
    held = measure(fitted.machine, bags, namespace, request.averaging)
    if len(held.q) != request.verification:
        raise PkmError(f'{len(held.q)} rests in {len(bags)} bags; expected {request.verification}')
    after = positioning(held, verification_poses(fitted.machine, request))
    return verification_of(fitted, after)


def verification_of(fitted, after):
    """Return the `Verification` of the errors `after` (N, m) [m, rad] against those of the first visit."""
    rms, largest = (
        [each(errors) for errors in (fitted.commanded, after)]
        for each in (lambda e: np.sqrt(np.mean(e**2, axis=0)), lambda e: np.abs(e).max(axis=0))
    )
    return Verification(fitted.machine.coordinates, len(after), fitted.noise, *rms, *largest)
