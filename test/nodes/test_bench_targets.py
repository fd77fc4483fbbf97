"""The evaluation of `pkm bench` on given figures."""

import pytest

from pkm_nodes.bench.targets import growth, ratios, targets

STEADY = {'ticks_per_second': [4000.0, 2000.0, 1000.0], 'cpu_us_per_tick': [200.0, 210.0, 220.0]}


def test_ratio_is_the_median_over_the_turns():
    """Load that affects both subjects of a turn does not change it."""
    twice = {'ticks_per_second': [8000.0, 4000.0, 500.0], 'cpu_us_per_tick': [100.0, 105.0, 900.0]}
    ratio = ratios({'composed': STEADY, 'floor': twice})['composed / floor']
    assert ratio == {'ticks_per_second': pytest.approx(0.5), 'processor_time': pytest.approx(0.5)}


def test_targets_are_met_missed_or_unknown():
    """A target with a value below its bound is missed; without a figure it is unknown."""
    slow = STEADY | {'delivery_ms': [[10.0, 20.0], [90.0, 95.0], [99.0, 40.0]]}
    account = {target.name: target for target in targets({'composed': slow, 'floor': STEADY}, [])}
    assert account['composed cell / bare floor'].met is True
    assert account['composed cell, best turn'].value == pytest.approx(2.0)
    assert account['trajectory to loaded controllers'].value == pytest.approx(65.0)
    assert account['trajectory to loaded controllers'].met is False
    assert account['processes / naive executor'].met is None


def test_memory_that_only_fills_its_pools_has_not_grown():
    assert growth([80.0, 95.0, *[100.0, 100.1] * 9]) == pytest.approx(0.0, abs=0.2)


def test_memory_leaked_at_every_cycle_has_grown():
    assert growth([100.0 + number for number in range(20)]) == pytest.approx(14.0)


def test_memory_growth_over_too_few_cycles_is_unknown():
    assert growth([100.0, 120.0]) is None
