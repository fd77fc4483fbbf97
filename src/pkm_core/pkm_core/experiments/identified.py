"""The first cycles of an identified machine: its own model and forces, the gains as shipped, nothing learned yet."""

from pkm_core.control.controllers import JointControllers
from pkm_core.control.model import load_model
from pkm_core.experiments.condition import prepared
from pkm_core.identification.identify import identify_joint
from pkm_core.identification.plan import Request, plan
from pkm_core.plant.random_truth import random_machine
from pkm_core.simulation.cycles import run_cycles
from pkm_core.simulation.experiment import SimulatedCell


def identified_models(machine, gains, seed, environment):
    """Return {joint: AxisModel} identified on the simulated machine under `gains`, as `pkm identify` does."""
    believed, request, found = load_model(machine), Request(), {}
    cell = SimulatedCell(machine, gains, seed, environment)
    for joint, experiments in plan(machine, request, believed, gains).items():
        records = [cell.run(experiment) for experiment in experiments]
        axis = identify_joint(machine, joint, records, believed, gains, band=request.sweep().band)
        found[joint] = axis.model(believed[joint].current_loop)
    return found


def first_cycles(condition, seed, cycles, number=None):
    """
    Return the largest dynamic error [m] by cycle (cycles,) of the worst axis, from power-up after an identification.

    The law of the `Condition` is not used. A `number` selects a random machine (`random_machine`).
    """
    given = prepared(condition)
    if number is None:
        return _first_cycles(given.machine, given, condition.environment, seed, cycles)
    with random_machine(given.machine, (seed, number), condition.environment) as drawn:
        return _first_cycles(drawn, given, condition.environment, seed, cycles)


def _first_cycles(machine, given, environment, seed, cycles):
    models = identified_models(machine, given.gains, seed, environment)
    controller = JointControllers(machine, given.gains, models)
    run = run_cycles(machine, given.joints, given.gains, None, cycles, seed, environment, controller=controller)
    return run.metric('max_dynamic_error').max(axis=1)
