"""Simulation of a condition without ROS, as the records that a run of the cell writes to its bags."""

from pathlib import Path

import numpy as np

from pkm_core.bag.cycle_record import CycleRecord
from pkm_core.experiments.condition import prepared
from pkm_core.simulation.cycles import run_cycles


def simulate(condition, seed, cycles, *, laser=True):
    """Return the `CycleRecord`s of `cycles` cycles of a `Condition` from power-up, and the notices of its monitors."""
    return simulate_prepared(prepared(condition), condition, seed, cycles, laser=laser)


def simulate_prepared(given, condition, seed, cycles, *, laser=True):
    """Return the result of `simulate` with the objects `given`, a `Prepared`, instead of those of the condition."""
    machine, motion, poses, joints, gains, law, start = given
    ran = run_cycles(machine, joints, gains, law, cycles, seed, condition.environment, start, laser)
    samples, unseen = len(joints), (np.zeros(0), np.zeros((0, len(machine.coordinates))))
    records = [
        CycleRecord(
            path=Path(),
            motion=motion,
            learning_law=condition.law,
            cycle=cycle + 1,
            joints=machine.joints,
            coordinates=machine.coordinates,
            sample_time=machine.sample_time,
            samples=samples,
            ticks=cycle * samples + np.arange(samples),
            counts=ran.counts[cycle],
            position=ran.counts[cycle] * machine.encoder_resolution,
            reference=joints.position,
            pose_reference=poses.position,
            voltage=ran.voltage[cycle],
            error=ran.error[cycle],
            feedforward=ran.feedforward[cycle],
            move_starts=joints.move_starts,
            move_ends=joints.move_ends,
            laser_time=time - machine.sample_time * cycle * samples,
            laser=displacement,
            recorded={},
            expected={},
            facts={},
        )
        for cycle, (time, displacement) in enumerate(ran.laser or [unseen] * cycles)
    ]
    return records, ran.notices
