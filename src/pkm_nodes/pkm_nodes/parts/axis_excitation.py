"""Excitation of one joint in cycles of identification: receive it, add it to the voltage, observe the bounds."""

import numpy as np

from pkm_core.identification.excited_axis import ExcitedAxis
from pkm_interfaces.msg import Excitation
from pkm_nodes.messages.conversions import is_identification
from pkm_nodes.parts.one_source import subscribe_one
from pkm_nodes.runtime.node import CYCLE_QOS


class AxisExcitation:
    """
    Subscribes to the topic `excitation` for one joint.

    Parameters
    ----------
    node : PkmNode
    machine : Machine
    joint : str

    """

    def __init__(self, node, machine, joint):
        self._machine, self._joint = machine, joint
        self._message = Excitation()  # the last one; cycles count from 1
        subscribe_one(node, Excitation, 'excitation', self._on_excitation, CYCLE_QOS)

    def _on_excitation(self, message):
        if message.joint == self._joint:
            self._message = message

    def is_missing(self, trajectory):
        """Return whether the cycle of a joint_trajectory message has to wait for its excitation."""
        return is_identification(trajectory) and self._message.cycle != trajectory.cycle

    def begin(self, trajectory, model, gains, position, velocity, acceleration):
        """Return the `ExcitedAxis` of a cycle of identification, else None; arguments and errors as there."""
        if not is_identification(trajectory):
            return None
        volts = np.array(self._message.voltage)
        return ExcitedAxis(self._machine, self._joint, model, gains, position, velocity, acceleration, volts)
