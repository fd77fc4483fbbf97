"""
Identification of the same axis by other software: sippy-unipi, nfoursid and scipy.signal.csd, each with its best input.

For K and a the output is speed, not position. The inputs are the voltage less the reaction of the other axes, and the
sign of the motion, which represents friction; both are delayed by the known computation. For the modes, subspace
methods get voltage and position less reference of one sweep (more accurate than all three sweeps) and their best order;
their least damped poles in the band are evaluated. scipy.signal.csd gives responses, to which the fit of this project
is applied.
"""

import warnings
from dataclasses import replace

import numpy as np
from scipy import signal

from pkm_core.identification import IdentificationError
from pkm_core.identification.frequency_fit import fit_high_frequency
from pkm_core.identification.prediction import moving_stretches

BAND = (80.0, 500.0)  # [Hz]
WINDOW = 2048  # [samples] of Welch's segments: two periods of the sweep are most accurate; one blurs, three scatter
BLOCK_ROWS = 30  # of the subspace methods
REFUSALS = (IdentificationError, ArithmeticError, ValueError, IndexError, np.linalg.LinAlgError)
ORDERS = {
    'ARX': {'ARX_orders': [[1], [[1, 1]], [[1, 1]]]},
    'ARMAX': {'ARMAX_orders': [[1], [[1, 1]], [1], [[1, 1]]]},
    'OE': {'OE_orders': [[[1, 1]], [1], [[1, 1]]]},
}


def quietly(method, axis):
    """Return the result of `method` for `axis`, or None on an error; warnings are suppressed."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        try:
            return method(axis)
        except REFUSALS:
            return None


def sippy_low(method, *, moving):
    """Return a function for (K, a) by a method of sippy-unipi, from the whole record or only its moves."""

    def run(axis):
        from sippy_unipi import system_identification

        speed, inputs = _speeds(axis.moves, moving)
        found = system_identification(
            speed[np.newaxis], inputs, method, tsample=axis.moves.sample_time, **ORDERS[method]
        )
        numerator, denominator = (np.trim_zeros(np.asarray(part[0][0])) for part in (found.G.num, found.G.den))
        return _continuous(-denominator[1] / denominator[0], numerator[0] / denominator[0], axis.moves.sample_time)

    return run


def nfoursid_low(axis):
    """Return (K, a) by nfoursid, a state-space model of first order."""
    import pandas
    from nfoursid.nfoursid import NFourSID

    speed, inputs = _speeds(axis.moves, moving=True)
    frame = pandas.DataFrame({'y': speed, 'u': inputs[0], 'd': inputs[1]})
    search = NFourSID(frame, output_columns=['y'], input_columns=['u', 'd'], num_block_rows=10)
    search.subspace_identification()
    model, _ = search.system_identification(rank=1)
    pole = model.a.item()
    return _continuous(pole, model.c.item() * model.b[0, 0] + (1 - pole) * model.d[0, 0], axis.moves.sample_time)


def _speeds(data, moving):
    """Return speed (N,) and inputs (2, N) at the same times."""
    speed, direction = np.diff(data.position) / data.sample_time, np.sign(np.gradient(data.reference))
    rows = np.arange(data.computation, len(speed))
    if moving:
        rows = np.concatenate([np.arange(stretch.start, stretch.end - 1) for stretch in moving_stretches(data)])
    return speed[rows], np.stack([data.net_voltage[rows - data.computation], direction[rows]])


def _continuous(pole, gain, sample_time):
    """Return K and a of a first-order lag with hold for this pole and numerator."""
    rate = -np.log(pole) / sample_time
    return gain * rate / (1 - pole), rate


def csd_response(*, instrument):
    """Return a function for the responses (sweeps, F) [m/V] at the lines of the sweep by scipy.signal.csd."""

    def run(axis):
        return [plant for plant, _ in _csd(axis, instrument)]

    return run


def csd_high(*, instrument):
    """Return a function for the modes by scipy.signal.csd and the fit of this project."""

    def run(axis):
        responses = [
            replace(shell, plant=plant, deviation=deviation)
            for shell, (plant, deviation) in zip(axis.responses, _csd(axis, instrument), strict=True)
        ]
        return fit_high_frequency(responses, axis.surroundings, len(axis.modes)).modes

    return run


def _csd(axis, instrument):
    """Return the response and its deviation [m/V] (F,) at the lines of every sweep by Welch's method."""
    found = []
    for data, factor in zip(axis.sweeps, axis.factors, strict=True):
        u, y, rate = data.voltage, data.position - data.reference, 1 / data.sample_time
        source = data.excitation if instrument else u
        frequency, over = signal.csd(source, y, fs=rate, nperseg=WINDOW)
        _, under = signal.csd(source, u, fs=rate, nperseg=WINDOW)
        _, coherence = signal.coherence(source, y, fs=rate, nperseg=WINDOW)
        at = np.searchsorted(frequency, axis.lines - 0.1)
        plant, coherence = (over[at] / under[at]) / factor, coherence[at]
        found.append((plant, np.abs(plant) * np.sqrt((1 - coherence) / (coherence * 2 * len(u) / WINDOW))))
    return found


def sippy_high(method, order):
    """Return a function for the modes by a subspace method of sippy-unipi."""

    def run(axis):
        from sippy_unipi import system_identification

        u, y = _excited(axis.sweeps[1])
        model = system_identification(
            y[np.newaxis], u[np.newaxis], method, SS_f=BLOCK_ROWS, SS_p=BLOCK_ROWS, SS_fixed_order=order
        )
        return _modes_of(model.A, model.B, model.C, model.D, axis.moves.sample_time, len(axis.modes))

    return run


def nfoursid_high(order):
    """Return a function for the modes by nfoursid."""

    def run(axis):
        import pandas
        from nfoursid.nfoursid import NFourSID

        u, y = _excited(axis.sweeps[1])
        search = NFourSID(pandas.DataFrame({'y': y, 'u': u}), ['y'], ['u'], num_block_rows=BLOCK_ROWS)
        search.subspace_identification()
        model, _ = search.system_identification(rank=order)
        return _modes_of(model.a, model.b, model.c, model.d, axis.moves.sample_time, len(axis.modes))

    return run


def _excited(data):
    """Return voltage and position less reference, scaled to 1, during the excitation."""
    active = np.flatnonzero(data.excitation)
    part = slice(active[0], active[-1])
    swing = (data.position - data.reference)[part]
    return data.voltage[part], swing / swing.std()


def _modes_of(A, B, C, D, sample_time, count):
    """Return the modes (count, 4) of a sampled system: its least damped poles in the band and the zeros above them."""

    def pairs(roots, highest):
        rates = np.log(roots[np.abs(roots) > 1e-3].astype(complex)) / sample_time
        rates = rates[rates.imag > 2 * np.pi * BAND[0]]
        found = np.column_stack([np.abs(rates) / (2 * np.pi), -rates.real / np.abs(rates)])
        found = found[(found[:, 0] < highest) & (np.abs(found[:, 1]) < 0.3)]
        found = found[np.argsort(np.abs(found[:, 1]))][:count]
        return found[np.argsort(found[:, 0])]

    zeros, poles, _ = signal.ss2zpk(A, B, C, D)
    resonances, antiresonances = pairs(poles, BAND[1]), pairs(zeros, 0.5 / sample_time)
    modes = np.full((count, 4), np.nan)
    modes[: len(resonances), :2] = resonances
    modes[: len(antiresonances), 2:] = antiresonances
    return modes
