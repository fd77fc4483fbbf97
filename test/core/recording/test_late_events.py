"""Events that arrive after the ticks of the next cycle: nothing is cut off."""

from support.recorded_cell import SAMPLES


def test_late_started_event_does_not_end_the_next_cycle(cell):
    """Seen under load: the events of cycle 1 came when half of cycle 2 had been recorded."""
    cell.load(1)
    for index in range(SAMPLES):
        cell.tick(1, index, index)
    cell.load(2)
    for index in range(SAMPLES // 2):
        cell.tick(2, SAMPLES + index, index)
    cell.recording.sort()
    cell.tell('STARTED', 1, 0)
    cell.finish(1, SAMPLES)
    cell.tell('STARTED', 2, SAMPLES)
    for index in range(SAMPLES // 2, SAMPLES):
        cell.tick(2, SAMPLES + index, index)
    cell.recording.sort()
    cell.finish(2, 2 * SAMPLES)
    assert [(o.cycle, o.failure, o.lost) for o in cell.recording.outcomes] == [(1, '', {}), (2, '', {})]
    assert cell.warnings == []


def test_cycle_of_a_restarted_machine_ends_the_one_before(cell):
    """Its number and its ticks begin again; the old cycle never gets an end event."""
    cell.load(2)
    cell.run(2, 500, end=20)
    cell.load(1)
    cell.run(1, 0)
    cell.finish(1, SAMPLES)
    interrupted, whole = cell.recording.outcomes
    assert interrupted.cycle == 2
    assert (whole.cycle, whole.lost) == (1, {})
