"""What stands around one joint controller in its tests: the axis it drives, and the service it learns from."""

from array import array

import numpy as np

from pkm_interfaces.msg import CycleEvent, EncoderSample, MotorCommand, SampledTrajectory
from pkm_interfaces.srv import UpdateFeedforward

UM = 1e-6
SAMPLES = 40  # of the short motion


class Axis:
    """The test in the place of the machine's axis d3."""

    column = 1

    def __init__(self, graph, joint_trajectory):
        self._graph = graph
        self.message = joint_trajectory
        self._trajectories = graph.publisher(SampledTrajectory, 'joint_trajectory')
        self._samples = graph.publisher(EncoderSample, 'd3/encoder')
        self.commands = graph.listen(MotorCommand, 'd3/command')
        self.reference = np.array(joint_trajectory(0).position).reshape(SAMPLES, 4)[:, self.column]
        self._tick = 0

    def send(self, trajectory):
        self._trajectories.publish(trajectory)

    def load(self, cycle, **named):
        self.send(self.message(cycle, **named))
        return self._graph.next_event(CycleEvent.LOADED, cycle=cycle)

    def sample(self, cycle, index, position, mode=EncoderSample.RUN):
        self._samples.publish(EncoderSample(tick=self._tick, cycle=cycle, index=index, position=position, mode=mode))
        self._tick += 1

    def answer(self):
        """Return the one command that has come."""
        self._graph.spin_until(lambda: self.commands, 'a command')
        return self.commands.pop()

    def run(self, cycle, error=lambda index: 0.0):
        """Play a whole cycle in which the slider lags by `error` [m]; return the commands."""
        commands = []
        for index, reference in enumerate(self.reference):
            self.sample(cycle, index, reference - error(index))
            commands.append(self.answer())
        return commands


class Learning:
    """The test in the place of the learning service: notes the requests and gives the answers it is told to."""

    def __init__(self, graph):
        self.requests = []
        self.answers = []
        graph.node.create_service(UpdateFeedforward, 'learning/update', self._on_update)

    def _on_update(self, request, response):
        self.requests.append(request)
        response.success, response.message, response.feedforward, response.session = self.answers.pop(0)
        return response

    def will_answer(self, feedforward, session=''):
        self.answers.append((True, '', array('d', feedforward), session))

    def will_refuse(self, message):
        self.answers.append((False, message, array('d'), ''))


def feedforward_of(commands):
    return [command.feedforward for command in commands]
