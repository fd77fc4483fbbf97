"""
Signals of other people's bags as series over time.

Messages without the named number are skipped and counted. The time of a sample is its header stamp; without a header,
or if all stamps of the topic are 0, it is the time of reception. A clock that cannot place the samples is refused.
"""

from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from pkm_core.bag.signals import read_samples
from pkm_core.errors import BagError
from pkm_core.identification import IdentificationError

RECEPTION, STAMPS = 'time of reception', 'header stamps'
_LATE = 1.5  # [median steps] a message later than this is no reordering of neighbours: the clock has stepped back
_CONTRADICT = 0.01  # largest share of messages with the stamp of another message and another value


@dataclass(frozen=True)
class Series:
    """Values of a signal over time, in the unit of the bag; times increase strictly."""

    times: np.ndarray  # (N,) int64 [ns]
    values: np.ndarray  # (N,)
    clock: str  # RECEPTION or STAMPS


def read_series(path, signals):
    """
    Return ({name: Series}, warnings) of the `Signal`s {name: signal} in the bag `path`.

    Raises
    ------
    BagError
        If `path` cannot be read, or lacks a topic or field.
    IdentificationError
        If a signal has fewer than two samples, or its clock steps back or stands.

    """
    found, warnings, series = read_samples(path, signals), [], {}
    for name, signal in signals.items():
        samples, skipped = _finite(found[name], signal)
        where = f'{Path(path).name}: {signal}'
        total = len(samples) + sum(skipped.values())
        reasons = '; '.join(f'{count} {reason}' for reason, count in skipped.items())
        if not samples and skipped:
            raise BagError(f'{path}: {signal.topic}: no number at {signal.field!r} in {total} messages: {reasons}')
        if len(samples) < 2:
            raise IdentificationError(f'{path}: {signal.topic} has {len(samples)} messages; at least 2 are needed')
        if skipped:
            warnings.append(f'{where}: {total - len(samples)} of {total} messages are skipped: {reasons}')
        series[name] = _on_a_clock(where, samples, warnings)
    return series, list(dict.fromkeys(warnings))


def _finite(found, signal):
    """Return (samples, {reason: count}) of `read_samples` with the values that are not finite among the skipped."""
    samples, skipped = found
    finite = [sample for sample in samples if isfinite(sample[-1])]
    lost = len(samples) - len(finite)
    return finite, skipped | ({f'with {signal.field} not finite': lost} if lost else {})


def _on_a_clock(where, samples, warnings):
    """Return the `Series` of `samples` (stamp or None, time of reception, value) in the order of the bag."""
    stamps = np.array([-1 if stamp is None else stamp for stamp, _, _ in samples], dtype=np.int64)
    received = np.array([time for _, time, _ in samples], dtype=np.int64)
    values = np.array([value for *_, value in samples])
    clock = RECEPTION if (stamps <= 0).all() else STAMPS
    if clock == RECEPTION:
        if stamps[0] == 0:
            warnings.append(f'{where}: all {len(stamps)} header stamps are 0; the {RECEPTION} is used')
        order = np.argsort(received, kind='stable')
        return _without_doubles(where, received[order], values[order], clock, warnings)
    zero = stamps <= 0
    if zero.sum() > 1:  # simulated time may begin at 0
        warnings.append(f'{where}: {zero.sum()} of {len(stamps)} messages are skipped: their header stamp is 0')
        stamps, values = stamps[~zero], values[~zero]
    _refuse_steps_back(where, stamps, warnings)
    order = np.argsort(stamps, kind='stable')
    return _without_doubles(where, stamps[order], values[order], clock, warnings)


def _refuse_steps_back(where, stamps, warnings):
    """Refuse stamps that fall back by more than a swap of neighbours; warn of swaps."""
    steps = np.diff(stamps)
    late = np.maximum.accumulate(stamps)[:-1] - stamps[1:]
    behind = np.count_nonzero(late > 0)
    if not behind:
        return
    usual, worst = float(np.median(np.abs(steps))), int(np.argmax(late))
    if late[worst] > _LATE * usual:
        raise IdentificationError(
            f'{where}: the clock steps back by {1e-9 * late[worst]:.6g} s at message {worst + 1}; the usual step is '
            f'{1e-9 * usual:.6g} s; use the part of the bag before or after it'
        )
    warnings.append(f'{where}: {behind} messages arrived after a later one; they are sorted by their stamps')


def _without_doubles(where, times, values, clock, warnings):
    """Return the `Series` without messages at the time of the one before; refuse many that contradict each other."""
    new = np.append(True, np.diff(times) > 0)
    if not new.all():
        contradict = np.count_nonzero(~new & (values != np.roll(values, 1)))
        if new.sum() < 2 or contradict > _CONTRADICT * len(times):
            raise IdentificationError(
                f'{where}: {len(times) - new.sum()} of {len(times)} messages have the time of the one before '
                f'({clock}), {contradict} of them with another value; allowed {100 * _CONTRADICT:g} %'
            )
        warnings.append(f'{where}: {len(times) - new.sum()} messages have the time of the one before; they are skipped')
    return Series(times[new], values[new], clock)
