"""The records of a long run keep figures of all cycles and arrays of two."""

from weakref import ref

import numpy as np
import pytest

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.reporting.figures import plot_cycles
from pkm_core.reporting.run_records import RunRecords
from pkm_core.reporting.summary import cycle_figures, cycles_table, first_and_last, messages

CYCLES = 6


@pytest.fixture(scope='module')
def bags(start_recording_in, make_cycle, tmp_path_factory):
    """Return the bags of cycles whose error falls."""
    folder = tmp_path_factory.mktemp('run')
    for number in range(1, CYCLES + 1):
        recording = start_recording_in(folder, make_cycle('planar', 20e-6 / number), number, first_tick=400 * number)
        recording.ticks()
        recording.close()
    return sorted(folder.iterdir())


def test_figures_are_those_of_all_records(bags, tmp_path):
    every, kept = [read_cycle(bag) for bag in bags], RunRecords(map(read_cycle, bags))
    assert len(kept) == CYCLES
    assert [row['axes'] for row in kept.rows] == [cycle_figures(record) for record in every]
    assert [row['bag'] for row in kept.rows] == [bag.name for bag in bags]
    assert kept.messages == messages(every)
    assert [record.metrics() for record in kept] == [record.metrics() for record in every]
    assert cycles_table('planar', kept).columns[2]._cells == cycles_table('planar', every).columns[2]._cells
    for name, records in (('every.png', every), ('kept.png', kept)):
        plot_cycles(records, tmp_path / name)
    assert (tmp_path / 'kept.png').read_bytes() == (tmp_path / 'every.png').read_bytes()


def test_arrays_of_two_cycles_are_kept(bags):
    read, most = [], 0

    def alive():
        return [each for each in read if each() is not None]

    def records():
        nonlocal most
        for bag in bags:
            record = read_cycle(bag)
            read.append(ref(record))
            most = max(most, len(alive()))
            yield record
            del record

    kept = RunRecords(records())
    assert most <= 3, 'the first, the last, and the one that is being read'
    assert len(alive()) == 2
    assert all(isinstance(record.error, np.ndarray) for record in first_and_last(kept))


def test_run_of_one_cycle_has_one_record(bags):
    (record,) = first_and_last(RunRecords([read_cycle(bags[0])]))
    assert record.cycle == 1
