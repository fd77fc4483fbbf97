"""Log lines about messages, whose number a sender decides: one line per second and topic, with the count."""

from time import monotonic

# [s, wall] between two lines on one topic
_PERIOD = 1.0
# most topics that are told apart; lines on further ones share a count
_MOST = 100


class LogThrottle:
    """
    Passes on at most one line per second and topic.

    Parameters
    ----------
    logger : RcutilsLogger
    is_error : bool
        Log errors instead of warnings.

    """

    def __init__(self, logger, *, is_error=False):
        self._logger, self._is_error = logger, is_error
        self._last = {}  # topic: (time of its last line [s, wall], lines that were not written since)

    def __call__(self, text, topic=None):
        """Log `text` about `topic`, by default what stands before its first colon; or count it."""
        topic = text.partition(':')[0] if topic is None else topic
        topic = topic if topic in self._last or len(self._last) < _MOST else ''
        now = monotonic()
        before, left_out = self._last.get(topic, (-_PERIOD, 0))
        if now - before < _PERIOD:
            self._last[topic] = before, left_out + 1
            return
        self._last[topic] = now, 0
        line = f'{text} (and {left_out} more since the last line)' if left_out else text
        if self._is_error:  # two lines of code: rclpy raises if one of them changes its severity
            self._logger.error(line)
        else:
            self._logger.warning(line)
