"""What `pkm run` says about the recorded messages of its cycles."""

import pytest

from pkm_core.reporting.summary import account

WHOLE = {'/pkm/pose': {'recorded': 34, 'expected': 34}, '/pkm/markers': {'recorded': 3, 'expected': None}}


@pytest.mark.parametrize(
    ('changed', 'lines'),
    [
        ({}, ['34 messages recorded of 34 expected: 0 lost']),
        (
            {'/pkm/laser': {'recorded': 20, 'expected': 50}},
            [
                '54 messages recorded of 84 expected: 30 lost',
                'lost: 30 of /pkm/laser; the nodes that publish them were stopped or too slow',
            ],
        ),
        (
            {'/pkm/laser': {'recorded': 52, 'expected': 50}},
            [
                '86 messages recorded of 84 expected: 0 lost',
                '2 messages more than expected: topics of the cell have further publishers',
            ],
        ),
    ],
)
def test_lost_and_surplus_messages_are_named(changed, lines):
    assert account(WHOLE | changed) == lines
