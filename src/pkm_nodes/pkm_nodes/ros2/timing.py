"""Time statistics of `ros2 topic hz`, `delay` and `echo`: over a window of messages, at the receiver."""

from collections import deque

import numpy as np

from pkm_nodes.ros2.shared import FIND_TIMEOUT, TOPIC_HELP, add_graph_arguments, number

RECEIVED_HERE = 'measured at this receiver: lost messages and waiting in this process are included'
_SHARES = (50, 95, 99)


def add_window_arguments(parser, what):
    """Add the arguments of a verb that measures `what` of a topic over a window of messages."""
    add_graph_arguments(parser, FIND_TIMEOUT)
    parser.add_argument('topic_name', help=TOPIC_HELP)
    parser.add_argument(
        '--window',
        '-w',
        type=number(int, lambda n: n > 0, 'a positive integer'),
        default=10000,
        help=f'window size, in # of messages, for calculating {what} (default: %(default)s)',
    )


class Window:
    """
    The last `size` times [ns] and their statistics, reported at most once per second.

    Attributes
    ----------
    times : deque of int
        [ns], oldest first.

    """

    def __init__(self, size):
        self.times = deque(maxlen=size)
        self._reported = None  # [ns]

    def clear(self):
        """Clear all times, for example after a reset of simulated time."""
        self.times.clear()
        self._reported = None

    def is_due(self, now):
        """Return whether at the time `now` [ns] the last report is at least one second old."""
        if self._reported is None:
            self._reported = now
        if now - self._reported < 1e9:
            return False
        self._reported = now
        return True

    def mean(self):
        """Return the mean [s]."""
        return float(np.mean(self.times)) * 1e-9

    def summary(self):
        """Return the line of ros2cli, and one with the percentiles."""
        seconds = np.array(self.times) * 1e-9
        return (
            f'\tmin: {seconds.min():.3f}s max: {seconds.max():.3f}s '
            f'std dev: {seconds.std():.5f}s window: {len(seconds)}\n\t{self.percentiles()}'
        )

    def percentiles(self):
        """Return the percentiles as text."""
        values = np.percentile(np.array(self.times) * 1e-3, _SHARES)
        return ' '.join(f'{share} %: {value:.0f}us' for share, value in zip(_SHARES, values, strict=True))


class Intervals:
    """The times between messages."""

    def __init__(self, size):
        self.window = Window(size)
        self._last = None  # [ns] time of the last message

    def count(self, now):
        """Count a message at the time `now` [ns]; return a report at most once per second, else None."""
        if self._last is None or now < self._last:  # the first, or simulated time was reset
            self.window.clear()
            self._last = now
            return None
        self.window.times.append(now - self._last)
        self._last = now
        if not self.window.is_due(now):
            return None
        mean = self.window.mean()
        return f'average rate: {1 / mean if mean else 0:.3f}\n{self.window.summary()}'
