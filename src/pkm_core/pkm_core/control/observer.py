"""
The observer law of one axis, evaluated once per encoder tick; its design is in observer_design.py.

    e = r - y, in um;  x is the deviation of the axis from its reference, d the disturbance as a voltage
    (x, d) = (x, d) + M (-e - x_n)
    u = -K x - d + uf, saturated at +-limit
    x = A x + B (u - uf + d)

uf is the feedforward: the exact inverse of the sampled model on the Fourier series of the cycle (forces.py), which
covers delays and zeros in the right half plane, plus the learned voltage. Anti-windup: the filter gets the saturated
voltage.
"""

import numpy as np
from numba import njit

from pkm_core.config import Config, load_config
from pkm_core.control.axis import AxisController
from pkm_core.control.margins import require_stable, require_stable_set
from pkm_core.control.model import Forces, in_joint_order, load_model
from pkm_core.control.observer_design import ObserverLaw, ObserverWeights

# of a model without identified forces: the design's coupling, no friction, no ripple
_COUPLING = Forces(coulomb=0.0, slip=10e-6, coupling=1.0)


class ObserverFile(Config):
    """Weights of the observer laws."""

    joints: dict[str, ObserverWeights]


def load_observer(machine, name_or_path=None):
    """
    Return {joint: ObserverLaw} of config/control/observer, designed on the machine's models.

    Raises
    ------
    ConfigError
        If the file is refused or its joints are not those of the machine.
    PkmError
        If the loop of an axis is unstable on its model or within the uncertainty of the model.

    """
    path = machine.configuration.find('control/observer', name_or_path or machine.name)
    weights, laws = in_joint_order(machine, load_config(path, ObserverFile).joints, path), {}
    for joint, model in load_model(machine).items():
        laws[joint] = ObserverLaw(weights=weights[joint], model=model)
        require_stable_set(f'{path}: {joint}', laws[joint], model, machine.sample_time)
    return laws


@njit(cache=True)
def step(index, measured, reference, feedforward, parameters, state):
    """
    Advance `state` by one tick and return voltage and error.

    `parameters` are n, limit, A row by row, B, K, M; `state` is x, d, n values without meaning, samples at the limit.
    """
    n, limit = int(parameters[0]), parameters[1]
    error = reference[index] - measured
    innovation = -1e6 * error - state[n - 1]
    b = 2 + n * n
    signal = feedforward[index]
    for i in range(n):
        state[i] += parameters[b + 2 * n + i] * innovation
        signal -= parameters[b + n + i] * state[i]
    state[n] += parameters[b + 3 * n] * innovation
    signal -= state[n]
    voltage = min(max(signal, -limit), limit)
    if voltage != signal:
        state[2 * n + 1] += 1.0
    drive = voltage - feedforward[index] + state[n]
    for i in range(n):
        following = parameters[b + i] * drive
        for j in range(n):
            following += parameters[2 + i * n + j] * state[j]
        state[n + 1 + i] = following
    for i in range(n):
        state[i] = state[n + 1 + i]
    return voltage, error


class ObserverController(AxisController):
    """The observer law of one axis, see `AxisController`; `gains` is an `ObserverLaw`."""

    step = staticmethod(step)

    def __init__(self, gains, model, sample_time, voltage_limit):
        super().__init__(gains.on(model), model, sample_time, voltage_limit)

    def _parameters_of(self, gains):
        A, B, K, M = gains.design(self._sample_time)
        self._n = B.size
        return np.concatenate([[self._n, self._voltage_limit], A.ravel(), B, K, M])

    def _rest(self):
        return np.zeros(2 * self._n + 2)

    def _take_up(self, voltage):
        self._state[self._n] -= voltage

    def _model_with_forces(self):
        model = self._model
        return model if model.forces is not None else model.model_copy(update={'forces': _COUPLING})

    def exchange(self, gains, model=None):
        """
        Use other `gains`, and another `model` if given, from the next tick on, without a step of the voltage.

        The state is kept; that of other modes begins at rest. The disturbance takes up the difference.

        Raises
        ------
        PkmError
            If the loop is unstable on the model of its axis; the message has the margin, the old gains stay.

        """
        model = self._model if model is None else model
        gains = gains.on(model)
        require_stable('new gains', gains, model, self._sample_time)
        old, state, before = self._n, self._state, self._voltage_expected()
        self._model = model
        self._take(gains)
        if self._samples:
            self._feedforward = self._sum_feedforward()
        if self._n != old:
            self._state = self._rest()
            self._state[:3], self._state[-1] = state[:3], state[-1]
            self._state[3 : self._n - 1 : 2] = state[1]  # a mode at rest has the position of the load
            self._state[self._n - 1], self._state[self._n] = state[old - 1], state[old]
        self._take_up(before - self._voltage_expected())

    def _voltage_expected(self):
        """Return the voltage [V] of the next tick if its measurement is that expected."""
        n, state = self._n, self._state
        gains = self._parameters[2 + n * n + n : 2 + n * n + 2 * n]
        feedforward = self._feedforward_at(self._next) if self._samples else 0.0
        return float(feedforward - gains @ state[:n] - state[n])
