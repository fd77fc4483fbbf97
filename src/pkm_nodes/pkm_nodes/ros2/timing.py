"""Times as `ros2 topic hz`, `delay` and `echo` tell them: over a window of messages, where these are received."""

from collections import deque

import numpy as np

from pkm_nodes.ros2.shared import FIND_TIMEOUT, TOPIC_HELP, add_graph_arguments, number

RECEIVED_HERE = 'measured where the messages are received, here: what is lost on the way or waits here shows in them'
_SHARES = (50, 95, 99)


def add_window_arguments(parser, what):
    """Add the arguments of a verb that tells `what` of a topic over a window of messages."""
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
    The last `size` times [ns] and what to say of them, at most once a second.

    Attributes
    ----------
    times : deque of int
        [ns]

    """

    def __init__(self, size):
        self.times = deque(maxlen=size)
        self._reported = None  # [ns]

    def clear(self):
        """Begin anew, as when simulated time was reset."""
        self.times.clear()
        self._reported = None

    def is_due(self, now):
        """Tell whether at the time `now` [ns] the last report is a second old."""
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
        """Return the percentiles in words."""
        values = np.percentile(np.array(self.times) * 1e-3, _SHARES)
        return ' '.join(f'{share} %: {value:.0f}us' for share, value in zip(_SHARES, values, strict=True))


class Intervals:
    """The times between messages."""

    def __init__(self, size):
        self.window = Window(size)
        self._last = None  # [ns] time of the last message

    def count(self, now):
        """Count a message at the time `now` [ns]; return a report, at most one a second."""
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
