"""A cell on two hosts with a lossy line between them; `hosts.py` is the bench, this test the part that must hold."""

import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))
from hosts import Host, Line, run_over

SHORT_MOTION = """
machine: four_dof
profile: p7
lead_rest: 5 ms
move_time: 20 ms
settle_window: 10 ms
targets:
  - by: {d1: 0.5 mm, d3: 0.5 mm, d5: -0.4 mm, d7: 0.4 mm}
"""


@pytest.fixture(scope='module')
def may_make_hosts():
    try:
        with ExitStack() as stack:
            Host(stack)
    except OSError as refusal:
        pytest.skip(str(refusal))


@pytest.mark.usefixtures('may_make_hosts')
def test_cell_on_two_hosts_gives_the_bits_of_the_simulation(tmp_path):
    """The line between the hosts delays and loses frames."""
    motion = tmp_path / 'short.yaml'
    motion.write_text(SHORT_MOTION)
    outcome = run_over(Line(delay=0.5, jitter=0.1, loss=1.0), str(motion), cycles=2)
    assert outcome['same_bits']
    assert outcome['ticks_per_second'] > 0
