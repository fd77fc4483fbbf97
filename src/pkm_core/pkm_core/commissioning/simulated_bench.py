"""The bench of `commission` without ROS: the objects of the nodes, called in the same order, with the same bits."""

from pkm_core.commissioning.measured import MeasuredResponse
from pkm_core.commissioning.procedure import Identified
from pkm_core.control.model import load_model
from pkm_core.control.robust import load_control
from pkm_core.identification.fits import fit_records, write_results
from pkm_core.identification.plan import Request, plan
from pkm_core.learning import make_law
from pkm_core.simulation.cycles import run_cycles
from pkm_core.simulation.experiment import SimulatedCell


class SimulatedBench:
    """
    A simulated machine that is powered up for every experiment.

    Parameters
    ----------
    machine : Machine
        The simulated machine.
    trajectory : SampledTrajectory
        The motion, in joints.
    seed, environment : int, str
        Of the plant.
    folder : Path
        Folder for models and plots.

    """

    def __init__(self, machine, trajectory, *, seed, environment, folder):
        self._machine, self._trajectory, self._folder = machine, trajectory, folder
        self._seed, self._environment = seed, environment

    def start(self, name):
        """Do nothing: nothing runs between experiments, and each one reads the installed files."""

    def identify(self, on_step):
        """Return the `Identified` axes."""
        machine, request = self._machine, Request()
        models, gains = load_model(machine), load_control(machine)
        plans = plan(machine, request, models, gains)
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

    def move(self, cycles, law, on_step):
        """Return the metrics of `cycles` cycles of the motion."""
        machine, gains = self._machine, load_control(self._machine)
        learning = None if law == 'none' else make_law(law, machine, gains)
        records = run_cycles(machine, self._trajectory, gains, learning, cycles, self._seed, self._environment)
        return [list(cycle) for cycle in records.metrics]
