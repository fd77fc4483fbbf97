"""The bench of `commission` without ROS: the objects of the nodes, called in the same order, with the same bits."""

import numpy as np

from pkm_core.commissioning.measured import MeasuredResponse
from pkm_core.commissioning.procedure import Calibrated, Identified
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.design.cell_calibration import (
    Request,
    fit_measurements,
    plan_cycles,
    positioning,
    verification_of,
    verification_poses,
)
from pkm_core.design.measurement import load_laser
from pkm_core.identification.fits import fit_records, write_results
from pkm_core.identification.plan import Request as IdentificationRequest
from pkm_core.identification.plan import plan as plan_identification
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.simulation.calibration import measure_poses
from pkm_core.simulation.cycles import run_cycles
from pkm_core.simulation.experiment import SimulatedCell

_PLAN_SEED = 1  # of the poses, as that of `pkm calibrate-cell`


class SimulatedBench:
    """
    A simulated machine that is powered up for every experiment.

    Parameters
    ----------
    machine : Machine
        The simulated machine.
    machine_name : str
        Name or file of the machine, of which a calibrated file is a copy.
    motion : Motion
        The motion.
    seed, environment : int, str
        Of the plant.
    folder : Path
        Folder for models and plots.

    """

    def __init__(self, machine, machine_name, motion, *, seed, environment, folder):
        self._machine, self._machine_name, self._motion, self._folder = machine, machine_name, motion, folder
        self._seed, self._environment = seed, environment

    def start(self, name):
        """Do nothing: nothing runs between experiments, and each one reads the installed files."""

    def identify(self, on_step):
        """Return the `Identified` axes."""
        machine, request = self._machine, IdentificationRequest()
        models, gains = load_model(machine), load_control(machine)
        plans = plan_identification(machine, request, models, gains)
        cell = SimulatedCell(machine, gains, self._seed, self._environment)
        found, folder, steps, done = {}, self._folder / 'identified', sum(map(len, plans.values())), 0
        for joint, experiments in plans.items():
            records = []
            for experiment in experiments:
                on_step(f'identifying: {experiment.name}', done / steps)
                records.append(cell.run(experiment))
                done += 1
            found[joint] = fit_records(machine, joint, records, models, gains, request.sweep().band, folder)
        return Identified(
            write_results(folder, machine.name, found, models, 'pkm commission'),
            {joint: [MeasuredResponse.of(each) for each in axis.responses] for joint, axis in found.items()},
            [warning for axis in found.values() for warning in axis.warnings],
        )

    def calibrate(self, on_step):
        """Calibrate the machine in use and return the `Calibrated`; an accepted one is in use from then on."""
        before, request, laser = self._machine, Request(seed=_PLAN_SEED), load_laser()
        on_step('calibrating: visiting the poses', 0.1)
        seen = self._measured(before, np.vstack(plan_cycles(before, request)), laser)
        on_step('calibrating: fit', 0.6)
        file = self._folder / 'calibrated' / f'{before.name}.yaml'
        found = fit_measurements(before, self._machine_name, seen, request, file, 'a commissioning in simulation')
        verification = found.verification
        if verification.accepted:
            known = load_machine(file, before.configuration)
            on_step('calibrating: visiting the poses of the verification', 0.8)
            commanded = verification_poses(known, request)
            verification = verification_of(found, positioning(self._measured(known, commanded, laser), commanded))
        reasons = verification.reasons(before)
        if not reasons:
            self._machine = known
        return Calibrated(None if reasons else file, reasons, found.calibration.misfit, verification)

    def _measured(self, machine, poses, laser):
        return measure_poses(machine, poses, laser, self._seed, self._environment)

    def move(self, cycles, law, on_step):
        """Return the metrics of `cycles` cycles of the motion."""
        machine, gains = self._machine, load_control(self._machine)
        learning = None if law == 'none' else make_law(law, machine, gains)
        joints = to_joints(machine, plan(machine, self._motion))
        records = run_cycles(machine, joints, gains, learning, cycles, self._seed, self._environment)
        return [list(cycle) for cycle in records.metrics]
