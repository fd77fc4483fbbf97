"""Experiments on the real graph: every kind of condition gives the bits of the simulation in both arrangements."""

from dataclasses import replace

import numpy as np
import pytest

from pkm_core.experiments.condition import conditions
from pkm_core.experiments.graph_driver import graph_driver
from pkm_core.experiments.outcome import QUANTITIES
from pkm_core.experiments.runs import measure

DOMAIN = 141
PLANAR = {each.name: replace(each, settled=1) for each in conditions('planar')}


@pytest.mark.slow
@pytest.mark.parametrize(
    ('arrangement', 'names'),
    [('composed', ('computed torque', 'coupled', 'thesis law', 'XY stage')), ('processes', ('best law',))],
)
def test_run_on_the_graph_equals_the_simulation(arrangement, names, tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(DOMAIN))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    runs, done = [(replace(PLANAR[name], environment='hard'), 3) for name in names], []
    outcomes = graph_driver()(runs, 1, arrangement, tmp_path, lambda *progress: done.append(progress))
    assert [number for number, _ in done] == list(range(1, len(names) + 1))
    for on_graph, (condition, seed) in zip(outcomes, runs, strict=True):
        simulated = measure(condition, seed, 1)
        for source in ('encoders', 'laser'):
            for quantity in QUANTITIES:
                one, other = (getattr(each, source)[quantity] for each in (on_graph, simulated))
                np.testing.assert_array_equal(one, other, err_msg=f'{condition.name}: {source} {quantity}')
        for one, other in zip(on_graph.shown, simulated.shown, strict=True):
            np.testing.assert_array_equal(one.voltage, other.voltage)
            np.testing.assert_array_equal(one.feedforward, other.feedforward)
            np.testing.assert_array_equal(one.laser, other.laser)
        assert (on_graph.peak_voltage, on_graph.peak_power) == (simulated.peak_voltage, simulated.peak_power)
