"""Compile the servo loop once, so that no first tick waits for numba; `python -m pkm_core.warm_up` at set-up."""

from pkm_core.control.robust import load_control
from pkm_core.machines import load_machine
from pkm_core.motions import default_motion, load_motion, plan
from pkm_core.simulation import run_cycles
from pkm_core.trajectory import to_joints


def main():
    """Run one cycle of every machine that has a motion of its own."""
    for name in ('four_dof', 'planar'):
        machine = load_machine(name)
        trajectory = to_joints(machine, plan(machine, load_motion(default_motion(machine))))
        run_cycles(machine, trajectory, load_control(machine), None, cycles=1, seed=1)


if __name__ == '__main__':
    main()
