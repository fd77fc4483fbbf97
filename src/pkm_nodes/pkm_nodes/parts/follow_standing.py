"""Follows where the machine stands, from its reports."""

from pkm_core.motion.standing import Standing
from pkm_interfaces.msg import Standing as StandingMessage
from pkm_nodes.parts.one_source import subscribe_one
from pkm_nodes.runtime.node import LAST_VALUE_QOS


def follow_standing(node, machine):
    """
    Return the `Standing` of `machine`, which takes the reports of the machine from now on.

    The caller passes on the cycles that have ended, and resets: a machine of the user's own need not report.
    """

    def on_report(message):
        standing.reported(message.cycle, message.joints, message.position)

    standing = Standing(machine)
    subscribe_one(node, StandingMessage, 'machine/standing', on_report, LAST_VALUE_QOS)
    return standing
