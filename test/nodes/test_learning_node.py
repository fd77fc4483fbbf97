"""Node learning: bits and refusals of the service learning/update, and saving."""

import math
from array import array

import numpy as np
import pytest
from rcl_interfaces.msg import Log

from pkm_core.control.robust import load_control
from pkm_core.errors import ConfigError
from pkm_core.learning import make_law
from pkm_core.learning.store import origin_of, read
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_interfaces.msg import CycleEvent, RobustGains, SampledTrajectory
from pkm_interfaces.srv import SaveLearned, UpdateFeedforward
from pkm_nodes.messages.conversions import trajectory_to_msg
from pkm_nodes.nodes import learning
from pkm_nodes.nodes.learning import LearningNode
from pkm_nodes.parts.gain_parameters import gains_to_msg

SAMPLES = 200
MOTION = 'four_dof_70ms'


@pytest.fixture
def request_of():
    """Return a function that makes a valid request with the given fields replaced."""
    random = np.random.default_rng(3)
    error, feedforward = random.normal(scale=1e-5, size=SAMPLES), random.normal(size=SAMPLES)

    def request(**changed):
        valid = {
            'joint': 'd5',
            'law': 'fourier',
            'motion': 'short',
            'iteration': 2,
            'sample_time': 5e-4,
            'error': array('d', error),
            'feedforward': array('d', feedforward),
        }
        return UpdateFeedforward.Request(**valid | changed)

    return request


@pytest.fixture(scope='module')
def trajectory(machine):
    """Return the joint trajectory of the machine's default motion."""
    return to_joints(machine, plan(machine, load_motion(MOTION)))


class Cycles:
    """Replacement of the generator and the controllers."""

    def __init__(self, graph, trajectory):
        self._graph, self.trajectory = graph, trajectory
        self._publisher = graph.publisher(SampledTrajectory, 'joint_trajectory')
        self._log = graph.listen(Log, '/rosout')
        self._random = np.random.default_rng(4)

    def send(self, cycle, law, trajectory=None, motion=MOTION):
        trajectory = trajectory or self.trajectory
        self._publisher.publish(trajectory_to_msg(trajectory, cycle=cycle, motion=motion, learning_law=law))

    def verdict(self):
        """Wait for the convergence verdict of a law in the log and return it."""
        self._graph.spin_until(lambda: [m for m in self._log if 'converges' in m.msg], 'the verdict of the law')
        return next(m.msg for m in self._log if 'converges' in m.msg)

    def request(self, joint, cycle, law, **changed):
        samples = len(self.trajectory)
        error = 1e-5 * np.convolve(self._random.normal(size=samples), np.hanning(40), 'same')
        valid = {
            **{'joint': joint, 'law': law, 'motion': MOTION, 'cycle': cycle, 'iteration': 0, 'sample_time': 5e-4},
            **{'error': array('d', error), 'feedforward': array('d', self._random.normal(size=samples))},
        }
        return UpdateFeedforward.Request(**valid | changed)

    def learn(self, joint, cycle, law, **changed):
        """Return a request and the feedforward of its response."""
        request = self.request(joint, cycle, law, **changed)
        response = self._graph.call(UpdateFeedforward, 'learning/update', request)
        assert response.success, response.message
        return request, np.array(response.feedforward)


@pytest.fixture
def cycles(graph, trajectory):
    return Cycles(graph, trajectory)


def expected(law, request):
    error, feedforward = np.array(request.error), np.array(request.feedforward)
    return law.update(request.joint, error, feedforward, request.iteration, request.sample_time)


@pytest.mark.parametrize('name', ['fourier', 'fourier_pid', 'inverse', 'norm_optimal', 'basis'])
def test_reply_is_the_update_of_the_core_bit_for_bit(graph, machine, cycles, name):
    """The convergence verdict of the law is logged before."""
    graph.start(LearningNode)
    law = make_law(name, machine, load_control(machine))
    cycles.send(1, name)
    assert cycles.verdict() == law.verdict
    request, answer = cycles.learn('d5', 1, name)
    assert np.array_equal(answer, expected(law.with_reference(cycles.trajectory), request))


def test_reference_is_that_of_the_requested_cycle(graph, machine, cycles, short_motion):
    """Also after the trajectory of the next motion."""
    graph.start(LearningNode)
    cycles.send(1, 'basis')
    cycles.send(2, 'basis', to_joints(machine, short_motion), motion='short')
    cycles.send(3, 'none', to_joints(machine, short_motion), motion='short')
    graph.spin_in_silence()
    request, answer = cycles.learn('d1', 1, 'basis')
    law = make_law('basis', machine, load_control(machine)).with_reference(cycles.trajectory)
    assert np.array_equal(answer, expected(law, request))


def test_law_with_reference_needs_the_trajectory_of_the_cycle(graph, cycles):
    """Without it the request is refused."""
    graph.start(LearningNode)
    response = graph.call(UpdateFeedforward, 'learning/update', cycles.request('d1', 8, 'basis'))
    assert not response.success
    assert 'learning d1: the basis law needs the reference' in response.message


def test_changed_gains_select_the_law_for_these_gains(graph, machine, cycles):
    graph.start(LearningNode)
    configured = load_control(machine)['d3']
    softer = configured.model_copy(update={'kp': 0.9 * configured.kp})
    cycles.send(1, 'inverse')
    cycles.verdict()
    for gains in (configured, softer):
        request, answer = cycles.learn('d3', 1, 'inverse', has_gains=True, gains=gains_to_msg(gains))
        law = make_law('inverse', machine, {'d3': gains})
        assert np.array_equal(answer, expected(law, request))


def test_gains_without_their_flag_are_ignored(graph, machine, cycles):
    graph.start(LearningNode)
    cycles.send(1, 'inverse')
    cycles.verdict()
    softer = load_control(machine)['d3'].model_copy(update={'kp': 2000.0})
    request, answer = cycles.learn('d3', 1, 'inverse', gains=gains_to_msg(softer))
    law = make_law('inverse', machine, {'d3': load_control(machine)['d3']})
    assert np.array_equal(answer, expected(law, request))


def test_divergent_law_for_changed_gains_is_refused(graph, machine, cycles):
    graph.start(LearningNode)
    weak = load_control(machine)['d3'].model_copy(update={'kp': 2000.0, 'kd': 12.0, 'ki': 40000.0})
    cycles.send(1, 'fourier_pid')
    cycles.verdict()
    request = cycles.request('d3', 1, 'fourier_pid', has_gains=True, gains=gains_to_msg(weak))
    response = graph.call(UpdateFeedforward, 'learning/update', request)
    assert not response.success
    assert "learning law 'fourier_pid' would diverge" in response.message


def test_best_feedforward_is_saved_with_its_identity(graph, machine, cycles, tmp_path):
    graph.start(LearningNode, folder=str(tmp_path))
    cycles.send(1, 'basis')
    cycles.verdict()
    driven = {}
    for joint in machine.joints:
        for iteration, error in enumerate((3e-6, 1e-6, 2e-6)):
            request, _ = cycles.learn(
                joint, 1, 'basis', iteration=iteration, error=array('d', [error] * len(cycles.trajectory))
            )
            if error == 1e-6:
                driven[joint] = np.array(request.feedforward)
    path = tmp_path / 'learned.npz'
    response = graph.call(SaveLearned, 'learning/save', SaveLearned.Request(path=str(path)))
    assert response.success, response.message
    learned = read(path)
    assert learned.origin == origin_of(machine, MOTION, 'basis', load_control(machine), cycles.trajectory)
    assert np.array_equal(learned.feedforward, np.stack(list(driven.values()), axis=1))
    law = make_law('basis', machine, load_control(machine)).with_reference(cycles.trajectory)
    assert learned.parameters == {joint: law.parameters(joint, row) for joint, row in driven.items()}


@pytest.mark.parametrize('late', [True, False])
def test_saving_waits_for_the_requests_of_the_last_cycle(graph, machine, cycles, tmp_path, monkeypatch, late):
    """The wait is bounded."""
    monkeypatch.setattr(learning, 'PATIENCE', 30.0 if late else 0.3)
    graph.start(LearningNode, folder=str(tmp_path))
    events = graph.publisher(CycleEvent, 'cycle_events')
    for cycle in (1, 2):
        cycles.send(cycle, 'fourier')
    cycles.verdict()

    def learn(cycle, error):
        rows = {'error': array('d', [error] * len(cycles.trajectory)), 'iteration': cycle - 1}
        return [np.array(cycles.learn(joint, cycle, 'fourier', **rows)[0].feedforward) for joint in machine.joints]

    first = learn(1, 2e-6)
    events.publish(CycleEvent(event=CycleEvent.FINISHED, source='machine', cycle=2))
    graph.spin_in_silence()
    path = tmp_path / 'learned.npz'
    client = graph.node.create_client(SaveLearned, 'learning/save')
    saved = client.call_async(SaveLearned.Request(path=str(path)))
    if late:
        graph.spin_in_silence()
        assert not saved.done()
        second = learn(2, 1e-6)
    graph.spin_until(saved.done, 'the answer')
    assert saved.result().success
    assert np.array_equal(read(path).feedforward, np.stack(second if late else first, axis=1))


def test_saving_is_refused_without_feedforward_of_all_joints(graph, cycles):
    """Also into a folder that is not writable."""
    graph.start(LearningNode, folder='/')

    def refusal(path='/tmp/never.npz'):
        response = graph.call(SaveLearned, 'learning/save', SaveLearned.Request(path=path))
        assert not response.success
        return response.message

    assert refusal() == 'nothing has been learned yet'
    cycles.send(1, 'fourier')
    cycles.verdict()
    for joint in ('d1', 'd5'):
        cycles.learn(joint, 1, 'fourier')
    assert "no cycle of ['d3', 'd7'] yet" in refusal()
    for joint in ('d3', 'd7'):
        cycles.learn(joint, 1, 'fourier')
    assert '/proc/learned.npz: cannot be written' in refusal('/proc/learned.npz')


def test_service_keeps_no_state(graph, request_of):
    graph.start(LearningNode)
    first, _, again = (
        graph.call(UpdateFeedforward, 'learning/update', request_of(joint=joint)) for joint in ('d5', 'd1', 'd5')
    )
    assert again.feedforward == first.feedforward


def spoiled(values, index, value):
    values[index] = value
    return array('d', values)


@pytest.mark.parametrize(
    ('changed', 'text'),
    [
        ({'joint': 'd2'}, "joint 'd2' is unknown; known: ['d1', 'd3', 'd5', 'd7']"),
        ({'law': 'magic'}, "learning law 'magic' is unknown; known: ["),
        ({'law': ''}, "learning law '' is unknown"),
        ({'error': array('d', [0.0] * (SAMPLES - 1))}, 'learning d5: error has 199 samples, feedforward 200'),
        ({'error': array('d'), 'feedforward': array('d')}, 'learning d5: error has shape (0,); expected (N,), N >= '),
        (
            {'error': spoiled([0.0] * SAMPLES, 17, math.nan)},
            'learning d5: error is nan at sample 17; expected a finite value',
        ),
        (
            {'feedforward': spoiled([0.0] * SAMPLES, 3, -math.inf)},
            'learning d5: feedforward is -inf at sample 3; expected a finite value',
        ),
        (
            {'has_gains': True},
            'learning d5: gains: kp: 0.0 given; allowed > 0 V/m',
        ),
        (
            {'has_gains': True, 'gains': RobustGains(kp=4e3, ki=-1.0, lag_pole=600.0, lag_zero=700.0, lag_dc_gain=1.0)},
            'learning d5: gains: ki: -1.0 given; allowed >= 0 V/(m s)',
        ),
        ({'sample_time': 1e-3}, 'learning d5: sample time is 0.001 s; expected 0.0005 s'),
        ({'sample_time': math.nan}, 'learning d5: sample time is nan s; expected 0.0005 s'),
    ],
)
def test_invalid_request_is_refused_and_the_next_one_served(graph, request_of, changed, text):
    graph.start(LearningNode)
    response = graph.call(UpdateFeedforward, 'learning/update', request_of(**changed))
    assert not response.success
    assert text in response.message
    assert len(response.feedforward) == 0
    assert graph.call(UpdateFeedforward, 'learning/update', request_of()).success


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'machine': 'five_dof'}, r"machines: 'five_dof' is unknown"),
        ({'control': 'soft'}, r"control: 'soft' is unknown; .*'four_dof'"),
        ({'law': 'fourier'}, r"/pkm/learning has unknown parameter\(s\) \['law'\]; known: .*'control'"),
    ],
)
def test_invalid_parameter_is_refused_by_name(graph, parameters, text):
    with pytest.raises(ConfigError, match=text):
        graph.start(LearningNode, **parameters)
