"""What a controller node gives to `CycleController`: its law, as functions, and the cycle that it drives."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pkm_core.motion.trajectory import SampledTrajectory
from pkm_interfaces.msg import SampledTrajectory as SampledTrajectoryMessage


def _nothing(*_):
    """Do nothing."""


@dataclass(frozen=True, eq=False)
class LoadedCycle:
    """A cycle with its trajectory in joints."""

    message: SampledTrajectoryMessage  # joint_trajectory
    trajectory: SampledTrajectory
    feedforward: np.ndarray | None  # (N, joints of the machine) [V] that the cycle brings along
    errors: np.ndarray  # (N, joints of the controller) [m], written on the tick path


@dataclass(frozen=True)
class CycleLaw:
    """
    The law of a controller, as functions that `CycleController` calls between ticks.

    Attributes
    ----------
    load : callable
        `load(LoadedCycle)`; `PkmError` if the law cannot drive it.
    reset : callable
        `reset()`: forget the state of the law. The machine stands, at home or after a safe stop.
    check : callable
        `check(message)`; `PkmError` if the law cannot drive the cycle of this joint_trajectory.
    extend : callable
        `extend(LoadedCycle, offset)`: check a piece of a jog, which begins at sample `offset` of the extended cycle;
        return the function that puts it in force before the tick of this sample; `PkmError` if the law cannot drive it.
    is_busy : callable
        `is_busy(message)`: whether the cycle of this joint_trajectory has to wait.
    learn : callable
        `learn(LoadedCycle)` after the last tick.
    notice : callable
        `notice()`: warning for the diagnostics, '' if there is none.

    """

    load: Callable
    reset: Callable
    extend: Callable
    check: Callable = _nothing
    is_busy: Callable = field(default=lambda _: False)
    learn: Callable = _nothing
    notice: Callable = field(default=lambda: '')
