"""The pace of ticks in wall time, its figures, its pauses, and the time that passes at rest."""

import math

import pytest

from pkm_core.errors import PkmError
from pkm_core.servo.pace import KEPT, Pace, RestClock, Turn, checked_pace, rest_step

TS = 0.5e-3
NOW, LATER, PAUSED = Turn


@pytest.mark.parametrize('value', [0.0, 0.01, 1.0, 1000.0])
def test_pace_in_range_is_returned(value):
    assert checked_pace(value, 'pace') == value


@pytest.mark.parametrize('value', [-1.0, math.nan, math.inf, -math.inf, 0.0099, 1000.1, -1e-9, 5e-324])
def test_pace_out_of_range_is_refused_with_the_range(value):
    with pytest.raises(PkmError) as refusal:
        checked_pace(value, '--pace')
    assert str(refusal.value) == (
        f'--pace: {value} given; allowed: 0 (as fast as possible), or 0.01 to 1000 times real time'
    )


def test_ticks_are_due_at_the_pace_from_the_first_one_on():
    pace = Pace(TS, 2.0)
    pace.begin(100, 7.0)
    assert [pace.due(tick) for tick in (100, 101, 140)] == pytest.approx([7.0, 7.00025, 7.01])
    assert pace.turn(101, 7.0002) is LATER
    assert pace.turn(101, 7.00025) is NOW


def test_late_tick_does_not_shift_those_after_it():
    pace = Pace(TS, 1.0)
    pace.begin(0, 0.0)
    pace.turn(1, 0.05)
    assert pace.due(2) == pytest.approx(2 * TS)


def test_schedule_that_is_far_behind_begins_anew():
    """A computer that slept for a minute does not race through the ticks of that minute."""
    pace = Pace(TS, 1.0)
    pace.begin(0, 0.0)
    assert pace.turn(1, 60.0) is NOW
    assert pace.due(2) == pytest.approx(60.0 + TS)


def test_free_machine_never_waits_and_keeps_no_lateness():
    pace = Pace(TS)
    pace.begin(0, 0.0)
    assert pace.is_free
    assert {pace.turn(tick, 0.0) for tick in range(10)} == {NOW}
    assert pace.lateness().ticks == 0
    assert math.isnan(pace.lateness().mean)


def test_paused_machine_begins_as_many_ticks_as_steps():
    pace = Pace(TS)
    pace.pause(5, 1.0)
    assert not pace.is_free
    assert pace.turn(5, 1.0) is PAUSED
    assert [pace.step(), pace.step()] == [1, 2]
    assert [pace.turn(5, 1.0), pace.turn(6, 1.0), pace.turn(7, 1.0)] == [NOW, NOW, PAUSED]
    pace.resume(7, 9.0)
    assert pace.turn(7, 9.0) is NOW


def test_steps_that_were_not_made_end_with_the_pause():
    pace = Pace(TS)
    pace.pause(5, 1.0)
    pace.step()
    pace.resume(5, 2.0)
    pace.pause(5, 3.0)
    assert pace.turn(5, 3.0) is PAUSED


def test_tick_after_a_pause_is_not_late():
    pace = Pace(TS, 1.0)
    pace.begin(0, 0.0)
    pace.pause(10, 0.005)
    pace.resume(10, 100.0)
    assert pace.turn(10, 100.0) is NOW
    assert pace.lateness().largest == 0.0
    assert pace.due(12) == pytest.approx(100.001)


def test_lateness_is_that_of_the_ticks():
    pace = Pace(TS, 1.0)
    pace.begin(0, 0.0)
    late = [1e-4] * 97 + [2e-4, 3e-4, 6e-4]
    for tick, each in enumerate(late):
        assert pace.turn(tick, tick * TS + each) is NOW
    found = pace.lateness()
    assert found.ticks == 100
    assert found.mean == pytest.approx(sum(late) / 100)
    assert found.percentile_99 == pytest.approx(3e-4)
    assert found.largest == pytest.approx(6e-4)
    assert found.share == pytest.approx(0.01)  # one of them by more than a tick


def test_lateness_forgets_old_ticks_and_those_of_another_pace():
    pace = Pace(TS, 1.0)
    pace.begin(0, 0.0)
    pace.turn(0, 0.01)
    for tick in range(1, KEPT + 1):
        pace.turn(tick, tick * TS)
    assert (pace.lateness().ticks, pace.lateness().largest) == (KEPT, 0.0)
    pace.set(2.0, KEPT + 1, 10.0)
    assert pace.lateness().ticks == 0


def test_pace_reached_leaves_out_pauses_and_rest():
    pace = Pace(TS)
    assert math.isnan(pace.reached(0, 5.0))
    pace.begin(0, 10.0)
    assert pace.reached(2000, 10.5) == pytest.approx(2.0)
    pace.pause(2000, 10.5)
    assert pace.reached(2000, 99.0) == pytest.approx(2.0)
    pace.resume(2000, 99.0)
    assert pace.reached(4000, 101.0) == pytest.approx(0.5)
    pace.end(4000, 101.0)
    assert pace.reached(4000, 1000.0) == pytest.approx(0.5)


def test_cycle_begins_a_whole_number_of_steps_after_the_last():
    clock = RestClock(200)
    clock.look(50.0, 2000.0)  # the machine stands
    clock.look(50.0305, 2000.0)
    assert clock.ticks == 61
    assert clock.leave() == 200
    assert (clock.ticks, clock.leave()) == (0, 0)


def test_time_at_rest_counts_only_while_the_machine_stands():
    clock = RestClock(200)
    clock.look(0.0, 2000.0)
    clock.leave()
    clock.look(60.0, 2000.0)  # after a cycle of a minute
    assert clock.ticks == 0
    clock.look(61.0, 0.0)  # paused
    clock.look(61.15, 2000.0)
    assert clock.leave() == 400


def test_rest_step_keeps_the_phase_of_topics_and_laser():
    step = rest_step(TS, 0.8e-3, 100)
    assert step % 100 == 0
    assert round(step * TS * 1e9) % round(0.8e-3 * 1e9) == 0
    assert step == 200


def test_sample_times_without_a_common_multiple_are_refused():
    with pytest.raises(PkmError, match=r'time: continuous given; sample times of 0.0005 s and of 0.00079999 s'):
        rest_step(TS, 0.79999e-3, 100)
