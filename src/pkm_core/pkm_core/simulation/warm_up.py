"""Compile the servo loop, for a first tick without compilation; set-up runs `python -m pkm_core.simulation.warm_up`."""

import numpy as np

from pkm_core.control.robust import load_control
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.plant.laser import Laser
from pkm_core.plant.plant import Plant
from pkm_core.plant.specimen import assemble
from pkm_core.plant.truth import load_truth
from pkm_core.simulation.cycles import run_cycles


def main():
    """Run one cycle of every machine that has a motion."""
    for name in ('four_dof', 'planar'):
        machine = load_machine(name)
        trajectory = to_joints(machine, plan(machine, load_motion(default_motion(machine))))
        run_cycles(machine, trajectory, load_control(machine), None, cycles=1, seed=1)
        plant, laser = Plant(machine, seed=1), Laser(machine, seed=1)
        laser.zero(0, plant.truth)
        plant.tick(np.zeros(len(machine.joints)))
        laser.observe(1, plant.truth)
        laser.read()
        assemble(machine, *load_truth(machine, 'geometric'), 1).end_point(machine.home, np.zeros(0))


if __name__ == '__main__':
    main()
