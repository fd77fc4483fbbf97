"""Callback groups by which an executor recognises the subscriptions of the servo tick."""

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup


class HotGroup(ReentrantCallbackGroup):
    """
    Subscriptions of the servo tick, which the lock-step executor serves before everything else.

    Attributes
    ----------
    subscriptions : dict of Subscription to TickSubscription

    """

    def __init__(self):
        super().__init__()
        self.subscriptions = {}


class PatientGroup(ReentrantCallbackGroup):
    """
    Raw subscriptions whose messages may wait while ticks flow.

    An executor of rclpy calls their callbacks with one serialized message. The lock-step executor calls them with
    several of equal size, as the rows of an (n, size) array of bytes, and the GIDs of their publishers, see queues.py.

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


class SenderGroup(MutuallyExclusiveCallbackGroup):
    """
    Raw subscriptions whose callbacks get the sender of a message: ``callback(data, sender=b'')``.

    The lock-step executor passes the GID of the publisher. The executors of rclpy do not know it.
    """
