"""Typed fields of the messages: kind of a cycle, kind of an identification."""

import pytest

from pkm_core.errors import TrajectoryError
from pkm_core.identification import IdentificationError
from pkm_core.identification.plan import KINDS
from pkm_interfaces.action import Identify
from pkm_interfaces.msg import SampledTrajectory
from pkm_nodes.messages.conversions import (
    experiments_from_msg,
    experiments_to_msg,
    is_identification,
    learns,
    trajectory_from_msg,
)

MOTION, IDENTIFICATION = SampledTrajectory.MOTION, SampledTrajectory.IDENTIFICATION


@pytest.mark.parametrize(
    ('kind', 'law', 'identification', 'learned'),
    [
        (MOTION, 'none', False, False),
        (MOTION, 'fourier', False, True),
        (MOTION, 'identify', False, True),  # a law may have any name
        (IDENTIFICATION, 'none', True, False),
        (IDENTIFICATION, 'fourier', True, False),
    ],
)
def test_kind_of_a_cycle_decides_what_it_is_for(kind, law, identification, learned):
    message = SampledTrajectory(kind=kind, learning_law=law)
    assert (is_identification(message), learns(message)) == (identification, learned)


def test_unknown_kind_of_a_cycle_is_refused():
    with pytest.raises(TrajectoryError, match=r'trajectory of cycle 4: kind is 2; allowed: 0 \(MOTION\), 1 \(IDENT'):
        trajectory_from_msg(SampledTrajectory(cycle=4, kind=2), coordinates=(), sample_time=0.0)


@pytest.mark.parametrize('kind', KINDS)
def test_kind_of_an_identification_survives_the_goal(kind):
    assert experiments_from_msg(experiments_to_msg(kind)) == kind


def test_empty_goal_of_an_identification_means_both():
    assert experiments_from_msg(Identify.Goal().kind) == experiments_from_msg(experiments_to_msg('')) == 'both'


def test_unknown_kind_of_an_identification_is_refused():
    with pytest.raises(IdentificationError, match=r'identify: kind is 3; allowed: 0 \(BOTH\)'):
        experiments_from_msg(3)
