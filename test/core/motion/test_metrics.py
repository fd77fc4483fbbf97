"""Metrics of hand-made error sequences: Ts = 1 ms, one or two moves."""

import math

import numpy as np
import pytest

from pkm_core.motion.metrics import axis_metrics

TS = 1e-3
UM = 1e-6


def one_move(rest):
    """Return the metrics of a move over samples 2 to 5 whose rest, from its end sample 5 on, has the errors `rest`."""
    error = np.concatenate([np.zeros(5), np.asarray(rest, dtype=float) * UM])
    return axis_metrics(error, [2], [5], TS)


def test_dynamic_error_counts_from_start_to_end_of_profile_only():
    error = np.array([9, 9, 1, -4, 2, 3, 8, 8]) * UM
    assert axis_metrics(error, [2], [5], TS).max_dynamic_error == pytest.approx(4 * UM)


@pytest.mark.parametrize('sample', [2, 5])
def test_dynamic_error_includes_first_and_last_sample_of_a_move(sample):
    error = np.zeros(8)
    error[sample] = -7 * UM
    assert axis_metrics(error, [2], [5], TS).max_dynamic_error == pytest.approx(7 * UM)


def test_dynamic_error_is_the_worst_of_all_moves():
    error = np.zeros(40)
    error[[3, 23]] = 2 * UM, -6 * UM
    assert axis_metrics(error, [2, 22], [5, 25], TS).max_dynamic_error == pytest.approx(6 * UM)


def test_settling_is_zero_when_inside_from_the_profile_end_on():
    metrics = one_move([5, -5, 0.5, 0.5])
    assert metrics.settling_time_5um == 0.0
    assert metrics.settling_time_1um == pytest.approx(2 * TS)


def test_settling_ends_one_sample_after_the_last_one_outside():
    assert one_move([9, 1, 1, -6, 4, 4]).settling_time_5um == pytest.approx(4 * TS)


def test_settling_is_nan_when_the_rest_ends_outside():
    metrics = one_move([1, 1, 1, 1.1])
    assert metrics.settling_time_5um == 0.0
    assert math.isnan(metrics.settling_time_1um)


def test_settling_is_the_worst_of_all_moves_and_nan_is_worst():
    error = np.zeros(40)
    error[[5, 6, 25]] = 9 * UM
    assert axis_metrics(error, [2, 22], [5, 25], TS).settling_time_5um == pytest.approx(2 * TS)
    error[21] = 9 * UM  # the last sample of the first rest
    assert math.isnan(axis_metrics(error, [2, 22], [5, 25], TS).settling_time_5um)


def test_rest_ends_before_the_next_move():
    error = np.zeros(40)
    error[22] = 9 * UM  # the first sample of the second move is not in the first rest
    metrics = axis_metrics(error, [2, 22], [5, 25], TS)
    assert metrics.settling_time_5um == 0.0
    assert metrics.steady_state_error == 0.0


def test_steady_state_is_the_signed_mean_of_the_last_10_ms():
    rest = np.concatenate([np.full(20, 50.0), np.tile([-3.0, -1.0], 5)])
    assert one_move(rest).steady_state_error == pytest.approx(-2 * UM)


def test_steady_state_is_the_largest_by_magnitude_with_its_sign():
    error = np.zeros(60)
    error[12:32], error[50:] = -3 * UM, 2 * UM
    assert axis_metrics(error, [2, 32], [5, 35], TS).steady_state_error == pytest.approx(-3 * UM)


def test_short_rest_is_averaged_as_a_whole():
    assert one_move([1, 2, 3]).steady_state_error == pytest.approx(2 * UM)
