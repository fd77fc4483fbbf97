"""Models of axes out of records: bags of the cell, or experiments on the simulated machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pkm_core.api.drawing import empty_figure
from pkm_core.api.typing import Array, checked_count, checked_joint
from pkm_core.control.controllers import choose_control
from pkm_core.control.model import AxisModel, load_model
from pkm_core.errors import PkmError
from pkm_core.identification import IdentificationError
from pkm_core.identification.axis_data import JointRecord
from pkm_core.identification.bag_data import read_cell_bag
from pkm_core.identification.identify import AxisIdentification, identify_joint
from pkm_core.identification.plan import Request
from pkm_core.identification.plan import plan as plan_experiments
from pkm_core.identification.prediction import moving_stretches, predict
from pkm_core.machines.base import Machine
from pkm_core.simulation.experiment import SimulatedCell

if TYPE_CHECKING:
    from control import FrequencyResponseData
    from matplotlib.figure import Figure


def run_experiments(
    machine: Machine,
    joint: str,
    *,
    kind: str = 'both',
    positions: int = 3,
    seed: int = 1,
    environment: str = 'nominal',
) -> tuple[JointRecord, ...]:
    """
    Return the records of the experiments that identify an axis, run on the simulated machine.

    They are the experiments of `pkm identify`: slow moves there and back for K and a, and a swept sine on a jog for the
    resonances. Source: thesis 7.3.2, 8.3.2.

    Parameters
    ----------
    machine : Machine
        From `load_machine`.
    joint : str
        One of `machine.joints`.
    kind : str
        'low_frequency' (slow moves), 'sweep' or 'both'.
    positions : int
        Places along the travel that the sweep visits, from 1.
    seed, environment : int, str
        Of the simulated machine, as for `simulate`.

    Returns
    -------
    records : tuple of JointRecord
        Each with `reference` [m], `counts`, `voltage` [V] of shape (N, n), and `excitation` [V] or None.

    Raises
    ------
    IdentificationError
        If the kind is unknown, or an experiment leaves travel, speed or voltage of the axis.
    PkmError
        If another argument is refused.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> records = pkm.run_experiments(pkm.load_machine('xy_stage'), 'x', kind='low_frequency')
    >>> len(records), records[0].voltage.shape[1], records[0].excitation is None
    (1, 2, True)

    """
    checked_joint('run_experiments', joint, machine.joints)
    positions = checked_count('run_experiments: positions', positions, 1)
    models, gains = load_model(machine), choose_control(machine)
    request = Request(joints=(joint,), kind=kind, positions=positions)
    cell = SimulatedCell(machine, gains, checked_count('run_experiments: seed', seed, 0), environment)
    return tuple(cell.run(experiment) for experiment in plan_experiments(machine, request, models, gains)[joint])


@dataclass(frozen=True, repr=False, eq=False)
class Identification:
    """
    The model of one axis as fitted to records, P = K H/(s (s + a)) with the resonances H.

    Attributes
    ----------
    joint : str
        The axis.
    gain, gain_deviation : float
        K and its standard deviation [m/s^2/V].
    viscosity, viscosity_deviation : float
        a and its standard deviation [1/s].
    modes : ndarray, shape (m, 4)
        Rows: resonance [Hz], its damping, anti-resonance [Hz], its damping; m is 0 without a sweep.
    fit_percent : float
        How much of the moves left out of the fit K and a explain; nan if there were too few.
    model : AxisModel
        For `axis_system`, `loop_system` and `margins`. Without a sweep its resonances are those of config/model.
    warnings : tuple of str
        What makes the result doubtful.
    sample_time : float
        [s]
    details : AxisIdentification
        Everything else: fits with covariances, measured responses, records.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> machine = pkm.load_machine('xy_stage')
    >>> fit = pkm.identify(machine, 'x', pkm.run_experiments(machine, 'x', kind='low_frequency'))
    >>> fit
    Identification(x: K = 5.57 +- 0.019 m/s^2/V, a = 11.9 +- 0.1 1/s, 0 modes, fit 99.8 %)
    >>> pkm.margins(machine, 'x', model=fit.model).nominal.stable
    True

    """

    joint: str
    gain: float
    gain_deviation: float
    viscosity: float
    viscosity_deviation: float
    modes: Array
    fit_percent: float
    model: AxisModel
    warnings: tuple[str, ...]
    sample_time: float
    details: AxisIdentification

    def __repr__(self) -> str:
        return (
            f'Identification({self.joint}: K = {self.gain:.3g} +- {self.gain_deviation:.2g} m/s^2/V, '
            f'a = {self.viscosity:.3g} +- {self.viscosity_deviation:.2g} 1/s, {len(self.modes)} modes, '
            f'fit {self.fit_percent:.1f} %)'
        )

    def measured_response(self) -> FrequencyResponseData:
        """
        Return the measured response of the plant as `control.FrequencyResponseData`: voltage [V] to position [m].

        Of several positions it is the one with the lowest gain, for which the thesis designs (7.3.2).

        Raises
        ------
        IdentificationError
            If no record had a sweep.

        """
        import control

        if self.details.lowest is None:
            raise IdentificationError(f'{self.joint}: no measured response; expected a record with a sweep')
        response = self.details.responses[self.details.lowest]
        return control.frd(response.plant, 2 * np.pi * response.frequency, dt=self.sample_time, name=self.joint)

    def plot(self) -> Figure:
        """Return a figure: position over every move, measured and as K and a predict it, and the difference."""
        figure = empty_figure(9.0, 6.0)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
        shift, labels = 0.0, ('encoder', 'K/(s (s + a))')
        for data in self.details.moves:
            stretches = moving_stretches(data)
            predictions = predict(stretches, self.viscosity, self.details.low_known)
            for stretch, prediction in zip(stretches, predictions, strict=True):
                time = 1e3 * (shift + self.sample_time * np.arange(len(prediction.measured)))
                error = prediction.error(self.gain)
                measured = data.position[stretch.start] + prediction.measured
                above.plot(time, 1e3 * measured, color='0.6', linewidth=3, label=labels[0])
                above.plot(time, 1e3 * (measured - error), color='k', linewidth=1, label=labels[1])
                below.plot(time, 1e6 * error, color='C3', linewidth=0.8)
                labels = ('', '')
                shift += self.sample_time * (len(time) + 10)
        above.set(ylabel='position [mm]', title=repr(self))
        above.legend()
        below.set(ylabel='difference [um]', xlabel='time of motion [ms], rests left out')
        for axes in (above, below):
            axes.grid(alpha=0.3)
        return figure


def identify(
    machine: Machine,
    joint: str,
    records: str | Path | JointRecord | Sequence[str | Path | JointRecord],
    *,
    controller: str | Path = 'robust',
    namespace: str = '/pkm',
    band: tuple[float, float] | None = None,
) -> Identification:
    """
    Return the model of an axis fitted to records of it.

    Records in which the joint moves without an excitation give K and a, by the prediction-error method with the
    reference as instrument; those with a sweep give the resonances, by least squares on the measured response. Source:
    Ljung, System Identification (1999), chapters 7 and 13; thesis (7.18)-(7.20).

    Parameters
    ----------
    machine : Machine
        That was recorded.
    joint : str
        One of `machine.joints`.
    records : path, JointRecord, or a sequence of them
        Folders of bags (ordinary cycles of `pkm run`, or those of `pkm identify-cell`), or what `run_experiments`
        returns. At least one has moves of this joint without an excitation.
    controller : str or Path
        The gains that ran meanwhile.
    namespace : str
        Of the cell in the bags.
    band : (float, float), optional
        Of the sweep [Hz]; by default where it has its power.

    Raises
    ------
    BagError
        If a bag cannot be read.
    IdentificationError
        If the joint never moves without an excitation, or a fit refuses its data.
    PkmError
        If the joint is unknown.

    Examples
    --------
    >>> import pkm_core as pkm
    >>> machine = pkm.load_machine('four_dof')
    >>> fit = pkm.identify(machine, 'd3', pkm.run_experiments(machine, 'd3', positions=1))
    >>> [round(float(resonance)) for resonance in fit.modes[:, 0]]
    [246, 446]

    """
    checked_joint('identify', joint, machine.joints)
    given = [records] if isinstance(records, str | Path | JointRecord) else list(records)
    taken, notes = [], []
    for each in given:
        if isinstance(each, JointRecord):
            taken.append(each)
            continue
        if not isinstance(each, str | Path):
            raise PkmError(f'identify: {type(each).__name__} among the records; expected bag folders or JointRecord')
        record, warnings = read_cell_bag(machine, each, namespace)
        taken.append(record)
        notes += warnings
    models, gains = load_model(machine), choose_control(machine, str(controller))
    found = identify_joint(machine, joint, taken, models, gains, band=band)
    return _identification(machine, found, models[joint], notes)


def _identification(
    machine: Machine, found: AxisIdentification, believed: AxisModel, notes: list[Any]
) -> Identification:
    gain_deviation, viscosity_deviation = found.low.deviations
    model = found.model(believed.current_loop)
    if found.high is None:  # a loop that is designed on no resonances would pass for more robust than it is
        model = model.model_copy(update={'modes': believed.modes})
    return Identification(
        joint=found.joint,
        gain=float(found.low.gain),
        gain_deviation=float(gain_deviation),
        viscosity=float(found.low.viscosity),
        viscosity_deviation=float(viscosity_deviation),
        modes=np.zeros((0, 4)) if found.high is None else found.high.modes,
        fit_percent=float(found.low.fit_percent),
        model=model,
        warnings=(*notes, *found.warnings),
        sample_time=machine.sample_time,
        details=found,
    )
