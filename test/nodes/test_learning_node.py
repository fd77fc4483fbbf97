"""Node learning: the service learning/update, its law's bits and its refusals."""

import math
from array import array

import numpy as np
import pytest

from pkm_core.control.robust import load_control
from pkm_core.errors import ConfigError
from pkm_core.learning import make_law
from pkm_interfaces.srv import UpdateFeedforward
from pkm_nodes.learning import LearningNode

SAMPLES = 200


@pytest.fixture
def request_of():
    """Return a function that makes a valid request, but for the fields it is given."""
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


@pytest.mark.parametrize('name', ['fourier', 'fourier_pid'])
def test_answer_is_the_law_of_the_core_bit_for_bit(graph, machine, request_of, name):
    graph.start(LearningNode)
    request = request_of(law=name)
    response = graph.call(UpdateFeedforward, 'learning/update', request)
    law = make_law(name, machine, load_control(machine))
    expected = law.update('d5', np.array(request.error), np.array(request.feedforward), 2, 5e-4)
    assert response.success, response.message
    assert response.message == ''
    assert np.array_equal(np.array(response.feedforward), expected)


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
            'learning d5: error is nan at sample 17; expected a finite one',
        ),
        (
            {'feedforward': spoiled([0.0] * SAMPLES, 3, -math.inf)},
            'learning d5: feedforward is -inf at sample 3; expected a finite one',
        ),
        ({'sample_time': 1e-3}, 'learning d5: sample time is 0.001 s; expected 0.0005 s'),
        ({'sample_time': math.nan}, 'learning d5: sample time is nan s; expected 0.0005 s'),
    ],
)
def test_request_that_cannot_be_learned_from_is_refused_and_the_next_one_is_answered(graph, request_of, changed, text):
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
def test_parameter_that_cannot_be_is_refused_by_name(graph, parameters, text):
    with pytest.raises(ConfigError, match=text):
        graph.start(LearningNode, **parameters)
