"""Callback groups by which an executor recognises the subscriptions of the servo tick."""

from rclpy.callback_groups import ReentrantCallbackGroup


class HotGroup(ReentrantCallbackGroup):
    """Subscriptions of the servo tick, which the lock-step executor serves before everything else."""


class PatientGroup(ReentrantCallbackGroup):
    """
    Raw subscriptions whose messages may wait while ticks flow.

    Their callbacks get one serialized message, or several of equal size as the rows of an (n, size) array of bytes.

    Parameters
    ----------
    emptied : callable
        Called after every turn in which the queues were emptied.

    """

    def __init__(self, emptied):
        super().__init__()
        self.emptied = emptied

    def ending_execution(self, entity):
        """Call `emptied` after a message that an executor of rclpy has served."""
        self.emptied()
