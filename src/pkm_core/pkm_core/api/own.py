"""An own controller or learning law in the simulation: its protocol, and the checks of what it returns."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np

from pkm_core.api.typing import Array, checked_array
from pkm_core.errors import LearningError, PkmError
from pkm_core.machines.base import Machine
from pkm_core.motion.trajectory import SampledTrajectory


@runtime_checkable
class Controller(Protocol):
    """
    Protocol of an own controller of all joints of a machine, for `simulate(..., controller=...)`.

    `simulate` calls `load` before every cycle, then `update` once per sample, in order. The object keeps its own state
    from cycle to cycle. The voltage is limited to the machine's `voltage_limit`; error and voltage are recorded by the
    simulation, not by the controller.

    Raises
    ------
    PkmError
        By `simulate`, if `update` returns another shape than (n,) or a value that is not finite; the sample is named.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> class Proportional:  # 4 V/mm on every joint
    ...     def load(self, trajectory, learned):
    ...         self.reference = trajectory.position
    ...
    ...     def update(self, index, measured):
    ...         return 4000.0 * (self.reference[index] - measured)
    >>> isinstance(Proportional(), pkm.Controller)
    True

    """

    def load(self, trajectory: SampledTrajectory, learned: Array) -> None:
        """Take the joint references of the next cycle, (N, n), and the learned feedforward (N, n) [V]."""

    def update(self, index: int, measured: Array) -> Array:
        """Return the voltages (n,) [V] for sample `index` of the cycle, at the `measured` joint positions (n,) [m]."""
        ...


@runtime_checkable
class LearningLaw(Protocol):
    """
    Protocol of an own learning law, for `simulate(..., law=...)`; the laws of the project have it as well.

    `simulate` calls `update` after every cycle but the last, once per joint. The result is limited to the machine's
    `voltage_limit`. If the law has a method `with_reference(trajectory)`, it is called once before the first cycle
    with the joint references, and the law it returns is used. The convergence test and the refusals of the project's
    laws do not apply; the monitor of each joint does: it returns to the best feedforward if the error diverges.

    Raises
    ------
    LearningError
        By `simulate`, if `update` returns another shape than (N,) or a value that is not finite; the joint is named.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> class Proportional:  # 2 V/mm, 5 ms ahead
    ...     def update(self, joint, error, feedforward, iteration, sample_time):
    ...         return feedforward + 2000.0 * np.roll(error, -round(5e-3 / sample_time))
    >>> isinstance(Proportional(), pkm.LearningLaw)
    True

    """

    def update(self, joint: str, error: Array, feedforward: Array, iteration: int, sample_time: float) -> Array:
        """
        Return the feedforward (N,) [V] of the next cycle.

        `error` (N,) [m] is reference minus position of the cycle, `feedforward` (N,) [V] what it was driven with,
        `iteration` the number of updates this feedforward has had, `sample_time` in seconds.
        """
        ...


class CheckedController:
    """A `Controller` as `run_cycles` takes it: the answers are checked and limited, the error is added."""

    def __init__(self, machine: Machine, controller: Controller) -> None:
        self._controller = controller
        self._shape, self._limit = (len(machine.joints),), machine.voltage_limit
        self._where = f'controller {type(controller).__name__}'
        self._reference: Array = np.empty((0, *self._shape))

    def load(self, trajectory: SampledTrajectory, learned: Array) -> None:
        """Pass a cycle on to the controller."""
        self._reference = trajectory.position
        self._controller.load(trajectory, learned.copy())

    def update(self, index: int, measured: Array) -> tuple[Array, Array]:
        """Return the limited voltage (n,) [V] and the error (n,) [m] of one sample."""
        answer = self._controller.update(index, measured.copy())
        voltage = checked_array(f'{self._where}: voltage of sample {index}', answer, self._shape)
        return np.clip(voltage, -self._limit, self._limit), self._reference[index] - measured


class CheckedLaw:
    """A `LearningLaw` as `run_cycles` takes it: the feedforward it returns is checked and limited."""

    def __init__(self, machine: Machine, law: Any) -> None:
        self._machine, self._law = machine, law

    def with_reference(self, trajectory: SampledTrajectory) -> CheckedLaw:
        """Return the law for a motion: this one if the own law has no `with_reference`."""
        bind = getattr(self._law, 'with_reference', None)
        return self if bind is None else CheckedLaw(self._machine, bind(trajectory))

    def update(self, joint: str, error: Array, feedforward: Array, iteration: int, sample_time: float) -> Array:
        """Return the limited feedforward (N,) [V] of the next cycle."""
        answer = self._law.update(joint, error.copy(), feedforward.copy(), iteration, sample_time)
        where = f'law {type(self._law).__name__}: feedforward of {joint} after update {iteration}'
        learned = checked_array(where, answer, feedforward.shape, LearningError)
        return np.clip(learned, -self._machine.voltage_limit, self._machine.voltage_limit)


def own_controller(machine: Machine, controller: Any) -> CheckedController:
    """Return `controller` with its answers checked; `PkmError` if it is no `Controller`."""
    if not isinstance(controller, Controller) or isinstance(controller, type):
        raise PkmError(
            f'simulate: controller is {_what(controller)}; allowed: a name, a YAML file of gains, or an object with '
            f'load(trajectory, learned) and update(index, measured)'
        )
    return CheckedController(machine, controller)


def own_law(machine: Machine, law: Any) -> CheckedLaw:
    """Return `law` with its answers checked; `LearningError` if it is no `LearningLaw`."""
    if not isinstance(law, LearningLaw) or isinstance(law, type | dict | set):
        raise LearningError(
            f'simulate: law is {_what(law)}; allowed: a name, a YAML file, None, or an object with '
            f'update(joint, error, feedforward, iteration, sample_time)'
        )
    return CheckedLaw(machine, law)


def _what(given: Any) -> str:
    return f'the class {given.__name__}, not an object of it' if isinstance(given, type) else repr(given)
