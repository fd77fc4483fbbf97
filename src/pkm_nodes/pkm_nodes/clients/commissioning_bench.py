"""The bench of a commissioning in the ROS graph: a cell of nodes around the simulated machine."""

from contextlib import ExitStack
from pathlib import Path

import numpy as np

from pkm_core.commissioning.measured import MeasuredResponse
from pkm_core.commissioning.procedure import Calibrated, Identified
from pkm_core.design.cell_calibration import Request as CalibrationRequest
from pkm_core.design.verification import Verification
from pkm_core.errors import PkmError
from pkm_core.identification.plan import Request
from pkm_nodes.clients.calibrate_client import CalibrateClient
from pkm_nodes.clients.cell_processes import CellProcesses
from pkm_nodes.clients.identify_client import IdentifyClient
from pkm_nodes.clients.own_bags import read_own

_PLAN_SEED = 1  # of the poses, as that of `pkm calibrate-cell`


class _Client(IdentifyClient, CalibrateClient):
    """Client of a running cell for all steps."""


class CellBench:
    """
    A cell whose controllers load installed files on request; use it in a ``with`` block.

    Parameters
    ----------
    machine_name, motion : str
        Name or file of the machine, and of the motion.
    machine : Machine
        What the controllers drive; the cell works with its configuration.
    arrangement, seed, environment
        As for `CellProcesses`.
    folder : Path
        Gets one folder per start of the cell: bags, models, logs of the processes.

    """

    def __init__(self, machine_name, machine, motion, arrangement, *, seed, environment, folder, plugins=''):
        self._machine_name, self._motion, self._folder = machine_name, motion, Path(folder)
        self._options = {'arrangement': arrangement, 'seed': seed, 'environment': environment}
        self._options |= {'configuration': machine.configuration, 'plugins': plugins}
        self._joints = machine.joints
        self._stack, self._is_well = ExitStack(), False

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stack.close()

    def start(self, name):
        """Start the cell; a cell that runs without fault keeps running and loads the files that are installed now."""
        if self._is_well:
            self._is_well = False  # after a refusal some nodes have the old files and some the new ones
            self._client.reload(self._joints, self._processes.check)
            self._is_well = True
            return
        self._stack.close()
        self._processes = self._stack.enter_context(
            CellProcesses(self._machine_name, folder=self._folder / name, **self._options)
        )
        self._client = self._stack.enter_context(_Client(session=self._processes.session))
        self._client.wait_until_up(self._processes.check)
        self._is_well = True

    def identify(self, on_step):
        """Return the `Identified` axes."""

        def on_feedback(feedback):
            on_step(f'identifying: {feedback.experiment or "fits"}', feedback.progress)

        result = self._client.identify(Request(), self._processes.check, on_feedback)
        responses = {fit.joint: [_response(each) for each in fit.responses] for fit in result.fits}
        return Identified(Path(result.model_file), responses, list(result.warnings))

    def calibrate(self, on_step):
        """Calibrate the cell and return the `Calibrated`; an accepted machine file is in use from then on."""

        def on_feedback(feedback):
            visit = f'pose {feedback.pose} of {feedback.poses}' if feedback.poses else 'fit'
            on_step(f'calibrating: {visit}', feedback.progress)

        request = CalibrationRequest(seed=_PLAN_SEED)
        result = self._client.calibrate(request, '.', self._processes.check, on_feedback)
        columns = (
            np.array(getattr(result, name)) for name in ('noise', 'before', 'after', 'before_largest', 'after_largest')
        )
        verification = Verification(tuple(result.coordinates), request.verification, *columns)
        file, reasons = Path(result.file), [result.message] if result.message else []
        return Calibrated(None if reasons else file, reasons, result.misfit, verification)

    def move(self, cycles, law, on_step):
        """Return the metrics of `cycles` cycles of the motion."""

        def on_feedback(feedback):
            worst = 1e6 * max(feedback.max_dynamic_error)
            on_step(f'{self._motion}, law {law}: worst axis {worst:.1f} um', feedback.cycle / cycles)

        try:
            log = self._client.execute(self._motion, cycles, law, self._processes.check, on_feedback)
        except PkmError:
            self._is_well = False  # it may be in a safe stop, or a process may have ended
            raise
        return [record.metrics() for record in read_own(log.bags, self._processes)]


def _response(message):
    """Return the `MeasuredResponse` of an AxisResponse message."""
    plant = np.array(message.real) + 1j * np.array(message.imag)
    frequency, coherence = np.array(message.frequency), np.array(message.coherence)
    return MeasuredResponse(message.name, message.position, frequency, plant, coherence)
