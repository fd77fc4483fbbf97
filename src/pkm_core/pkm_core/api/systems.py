"""Axes and loops as python-control systems, and their stability margins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pkm_core.api.drawing import empty_figure
from pkm_core.api.typing import Array, ComplexArray, checked_joint
from pkm_core.control import systems
from pkm_core.control.controllers import choose_control
from pkm_core.control.margin_plots import draw_bode, draw_nyquist, draw_sensitivity, model_loops
from pkm_core.control.margins import Margins, stability_margins, worst_margins
from pkm_core.control.model import AxisModel, load_model
from pkm_core.control.pid import AxisLaw
from pkm_core.errors import PkmError
from pkm_core.machines.base import Machine

if TYPE_CHECKING:
    from control import FrequencyResponseData, StateSpace, TransferFunction
    from matplotlib.figure import Figure

Form = Literal['ss', 'tf', 'frd']
GRID = (1.0, 800)  # lowest frequency [Hz] and number of lines of 'frd'


def axis_system(
    machine: Machine, joint: str, *, form: Form = 'ss', model: AxisModel | None = None
) -> StateSpace | TransferFunction | FrequencyResponseData:
    """
    Return the plant of one axis as a discrete python-control system: drive voltage [V] to position [m].

    It is z^-1 ZOH{P} at the machine's sample time: one sample of computation, the hold, the current loop, K/(s (s + a))
    and the resonances. Source: thesis (7.18)-(7.20); Franklin, Powell & Workman, Digital Control of Dynamic Systems,
    chapter 4 (zero-order hold).

    Parameters
    ----------
    machine : Machine
        From `load_machine`.
    joint : str
        One of `machine.joints`.
    form : str
        'ss' (`control.StateSpace`), 'tf' (`control.TransferFunction`) or 'frd' (`control.FrequencyResponseData` from
        1 Hz to half the sampling rate).
    model : AxisModel, optional
        By default that of config/model; e.g. the `model` of an `Identification`.

    Raises
    ------
    PkmError
        If the joint or the form is unknown.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> axis = pkm.axis_system(pkm.load_machine('four_dof'), 'd3')
    >>> axis.nstates, axis.dt
    (8, 0.0005)
    >>> decibels = 20 * np.log10(abs(axis(np.exp(2j * np.pi * 50 * axis.dt))))
    >>> round(float(decibels), 1)
    -80.9

    """
    column = checked_joint('axis_system', joint, machine.joints)
    found = model or load_model(machine)[machine.joints[column]]
    return _as_control(
        systems.plant_system(found, machine.sample_time), machine, form, f'{joint}_plant', 'voltage', 'position'
    )


def loop_system(
    machine: Machine,
    joint: str,
    *,
    controller: str | Path | Mapping[str, Any] = 'robust',
    form: Form = 'ss',
    model: AxisModel | None = None,
) -> StateSpace | TransferFunction | FrequencyResponseData:
    """
    Return the open loop L of one axis as a discrete python-control system: error [m] to position [m].

    L is the PID law, lag and notch in series with `axis_system`; ``control.feedback(L)`` is the closed loop. Source:
    thesis (7.21)-(7.25).

    Parameters
    ----------
    machine, joint, form, model
        As for `axis_system`.
    controller : str or Path or mapping
        'robust', 'observer' or 'computed_torque' with the machine's gains, a name or YAML file of gains, or
        {joint: gains}.

    Raises
    ------
    PkmError
        If the joint or the form is unknown, or there are no such gains.

    Examples
    --------
    >>> import control
    >>> import pkm_core as pkm
    >>> loop = pkm.loop_system(pkm.load_machine('four_dof'), 'd3')
    >>> bool((abs(control.feedback(loop).poles()) < 1).all())
    True

    """
    found = model or load_model(machine)[machine.joints[checked_joint('loop_system', joint, machine.joints)]]
    gains = _gains('loop_system', machine, joint, controller, found)
    return _as_control(
        systems.open_loop(gains, found, machine.sample_time), machine, form, f'{joint}_loop', 'error', 'position'
    )


@dataclass(frozen=True, repr=False, eq=False)
class LoopMargins:
    """
    Stability margins of one axis, of its model and the worst over 20 % of gain and 5 % of resonance.

    Attributes
    ----------
    joint : str
        The axis.
    nominal, worst : Margins
        Each with `gain_margin`, `gain_reduction` [dB], `phase_margin` [deg], `peak_sensitivity`, `disk_margin`,
        `crossover`, `bandwidth`, `bandwidth_3db`, `tracking_bandwidth` [Hz], `slowest_pole` and `stable`.
    frequency : ndarray, shape (F,)
        [Hz]
    loop : ndarray of complex, shape (F,)
        Open loop L of the model.
    perturbed : ndarray of complex, shape (P, F)
        Open loops of the perturbed models.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> found = pkm.margins(pkm.load_machine('four_dof'), 'd3')
    >>> found.nominal.stable, round(found.nominal.gain_margin, 1), round(found.nominal.phase_margin)
    (True, 8.7, 45)

    """

    joint: str
    nominal: Margins
    worst: Margins
    frequency: Array
    loop: ComplexArray
    perturbed: ComplexArray

    def __repr__(self) -> str:
        if not self.nominal.stable:
            return f'LoopMargins({self.joint}: unstable, slowest pole |z| = {self.nominal.slowest_pole:.4f})'
        parts = [
            f'gain {each.gain_margin:.1f} dB, phase {each.phase_margin:.0f} deg, max|S| {each.peak_sensitivity:.2f}'
            for each in (self.nominal, self.worst)
        ]
        return f'LoopMargins({self.joint}: {parts[0]}; worst {parts[1]})'

    def plot(self) -> Figure:
        """Return a figure: Nyquist, Bode, and sensitivity of the loop; perturbed loops are grey."""
        figure = empty_figure(13.0, 6.5)
        figure.suptitle(repr(self))
        left, right = figure.subfigures(1, 2)  # type: ignore[misc]
        draw_nyquist(left.subplots(), self.loop, self.perturbed)
        magnitude, phase, sensitivity = right.subplots(3, 1, sharex=True)
        draw_bode(magnitude, phase, self.frequency, self.loop, self.perturbed)
        draw_sensitivity(sensitivity, self.frequency, self.loop, self.perturbed)
        return figure


def margins(
    machine: Machine,
    joint: str,
    *,
    controller: str | Path | Mapping[str, Any] = 'robust',
    model: AxisModel | None = None,
) -> LoopMargins:
    """
    Return the stability margins of one axis under its controller.

    Source: thesis (7.26)-(7.29); disk margin: Seiler, Packard & Gahinet, An Introduction to Disk Margins (2020).

    Parameters
    ----------
    machine, joint, controller, model
        As for `loop_system`.

    Raises
    ------
    PkmError
        If the joint is unknown or there are no such gains.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> pkm.margins(pkm.load_machine('xy_stage'), 'z')
    Traceback (most recent call last):
    pkm_core.errors.PkmError: margins: joint 'z' given; known: ['x', 'y']

    """
    found = model or load_model(machine)[machine.joints[checked_joint('margins', joint, machine.joints)]]
    gains = _gains('margins', machine, joint, controller, found)
    frequency, loop, perturbed = model_loops(gains, found, machine.sample_time)
    return LoopMargins(
        joint,
        stability_margins(gains, found, machine.sample_time),
        worst_margins(gains, found, machine.sample_time),
        frequency,
        loop,
        np.array(perturbed),
    )


def _gains(where: str, machine: Machine, joint: str, controller: Any, model: AxisModel) -> AxisLaw:
    """Return the linear law of a joint, of a choice of controller."""
    gains = choose_control(machine, str(controller)) if isinstance(controller, str | Path) else controller
    if not isinstance(gains, Mapping) or joint not in gains:
        raise PkmError(f'{where}: controller {controller!r} given; expected a name or {{{joint!r}: gains, ...}}')
    axis_gains = gains[joint]
    return axis_gains if isinstance(axis_gains, AxisLaw) else axis_gains.pid(model)


def _as_control(system: systems.System, machine: Machine, form: str, name: str, source: str, target: str) -> Any:
    """Return a `System` in the `form` of python-control that was asked for."""
    import control  # takes seconds

    signals = {'name': name, 'inputs': [source], 'outputs': [target]}
    sample_time = machine.sample_time
    if form == 'ss':
        return control.ss(system.A, system.B, system.C, system.D, sample_time, **signals)
    if form == 'tf':
        return control.ss2tf(system.A, system.B, system.C, system.D, sample_time, **signals)
    if form == 'frd':
        omega = 2 * np.pi * np.geomspace(GRID[0], 0.5 / sample_time, GRID[1])
        return control.frd(system(np.exp(1j * omega * sample_time)), omega, dt=sample_time, **signals)
    raise PkmError(f"{name}: form {form!r} given; known: 'ss', 'tf', 'frd'")
