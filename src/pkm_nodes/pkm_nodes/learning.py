"""Node `learning`: the service learning/update; the error of one cycle in, the feedforward of the next one out."""

import sys
from array import array
from functools import cache

import numpy as np

from pkm_core.control.robust import load_control
from pkm_core.errors import PkmError
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_interfaces.srv import UpdateFeedforward
from pkm_nodes.node import PkmNode, run


class LearningNode(PkmNode):
    """Keeps no state: a learning law is a pure function of the request."""

    def __init__(self, **kwargs):
        super().__init__('learning', **kwargs)
        machine = load_machine(self.setting('machine', 'four_dof', 'machine of config/machines, or a YAML file'))
        control = self.setting('control', '', "gains: file of config/control or a YAML file; empty for the machine's")
        self.check_settings()
        gains = load_control(machine, control or None)
        self._law = cache(lambda name: make_law(name, machine, gains))
        self.create_service(UpdateFeedforward, 'learning/update', self._on_update)

    def _on_update(self, request, response):
        try:
            feedforward = self._law(request.law).update(
                request.joint,
                np.array(request.error),
                np.array(request.feedforward),
                request.iteration,
                request.sample_time,
            )
        except PkmError as error:
            response.message = str(error)
            self.get_logger().error(f'{request.joint}, {request.motion!r}: {error}')
            return response
        response.success = True
        response.feedforward = array('d', feedforward.tobytes())
        return response


def make_nodes():
    """Return this process's node."""
    return [LearningNode()]


def main(args=None):
    """Run the node as a process of its own."""
    sys.exit(run(make_nodes, args))
