"""Sources of cycle events: the topics by which they are identified."""

import pytest

from pkm_core.servo.event_sources import topics_of


@pytest.mark.parametrize(
    ('event', 'source', 'topics'),
    [
        *((event, 'machine', ('machine/cycle',)) for event in ('STARTED', 'FINISHED', 'FAULT', 'RESET', 'REFUSED')),
        *((event, 'recorder', ('recorder/tick',)) for event in ('RECORDED', 'NOT_RECORDED')),
        ('ANNOUNCED', 'my_generator', ('pose_trajectory',)),
        ('LOADED', 'd1', ('d1/command',)),
        ('REFUSED', 'd1', ('d1/command', 'joint_trajectory')),
        ('STOP', 'anyone', ()),
        ('NOTICE', '', ()),
    ],
)
def test_source_is_identified_by_its_topics(event, source, topics):
    assert topics_of(event, source) == topics


@pytest.mark.parametrize('event', ['STARTED', 'FINISHED', 'FAULT', 'RESET', 'RECORDED', 'NOT_RECORDED'])
@pytest.mark.parametrize('source', ['d1', '', 'Machine', 'identification'])
def test_events_that_end_a_cycle_have_one_source(event, source):
    assert topics_of(event, source) is None


@pytest.mark.parametrize('source', ['', '../d1', 'd 1', 40 * 'd', '~', 'd1/x', 'd1\n'])
def test_source_that_is_no_name_loads_and_refuses_nothing(source):
    assert topics_of('LOADED', source) is None
    assert topics_of('REFUSED', source) is None


@pytest.mark.parametrize('source', ['machine', 'recorder'])
def test_only_joints_load_cycles(source):
    assert topics_of('LOADED', source) is None


def test_unknown_event_has_no_source():
    assert topics_of('77', 'machine') is None
