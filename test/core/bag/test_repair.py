"""Repair of bags whose recorder was killed or whose file was damaged: intact chunks saved, missing ticks reported."""

import errno
import io
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import raw_messages, read_topics
from pkm_core.bag.repair import repair
from pkm_core.bag.writer import CHUNK_BYTES
from pkm_core.errors import BagError

# a program that writes texts of 1000 bytes into the bag `bag` of the folder named on its command line
WRITER = """
import os, resource, signal, sys
from pathlib import Path
from pkm_core.bag.writer import BagWriter
from pkm_core.bag.message_types import typestore

kind = 'std_msgs/msg/String'
bag = BagWriter(Path(sys.argv[1]) / 'bag', {'/text': kind}, {'motion': 'none'})

def write(number, filling):
    text = f'{number:04d}' + filling
    bag.write('/text', bytes(typestore().serialize_cdr(typestore().types[kind](data=text), kind)), number)
"""


def mcap_of(bag):
    return next(bag.glob('*.mcap'))


def chunks_of(bag):
    """Return (offset of its end, record) of every chunk of an intact bag."""
    with mcap_of(bag).open('rb') as stream:
        records = StreamReader(stream, emit_chunks=True).records
        return [(stream.tell(), record) for record in records if isinstance(record, Chunk)]


def copy_of_killed(bag, size, folder):
    """Return a copy of `bag` as left by a recorder that was killed when its file had `size` bytes."""
    copy = folder / bag.name
    copy.mkdir(parents=True)
    (copy / mcap_of(bag).name).write_bytes(mcap_of(bag).read_bytes()[:size])
    return copy


@pytest.mark.parametrize('filling', ['os.urandom(498).hex()', '996 * "x"'])
def test_killed_writer_loses_less_than_one_chunk(tmp_path, filling):
    """The program kills itself without flushing its streams, whose buffers could hold all well-compressed data."""
    end = f'for number in range(300): write(number, {filling})\nos.kill(os.getpid(), signal.SIGKILL)'
    done = subprocess.run([sys.executable, '-c', WRITER + end, tmp_path], timeout=60, check=False)
    assert done.returncode == -signal.SIGKILL
    result = repair(tmp_path / 'bag')
    saved = [int(message.data[:4]) for message in read_topics(result.path)['/text']]
    assert saved == list(range(len(saved))), 'all except the last'
    assert result.saved == {'/text': len(saved)}
    assert (300 - len(saved)) * 1000 < CHUNK_BYTES
    assert result.lost_bytes == 0, 'chunks on disk are intact'


def test_full_disk_loses_only_the_last_chunk(tmp_path):
    """The size of a file is limited to 200 kB."""
    end = """
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
try:
    for number in range(1000): write(number, os.urandom(498).hex())
except OSError as error:
    print(number, error.errno, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run(
        [sys.executable, '-c', WRITER + end, tmp_path], timeout=60, check=False, capture_output=True, text=True
    )
    number, reason = map(int, done.stdout.split())
    assert reason == errno.EFBIG
    lost = number + 1 - repair(tmp_path / 'bag').saved['/text']
    assert lost * 1000 < CHUNK_BYTES + 2000, 'a chunk ends with the message that fills it'


@pytest.mark.parametrize('number', [3, -1])
def test_truncated_bag_is_repaired_up_to_its_last_intact_chunk(write_bag, make_cycle, tmp_path, number):
    """The last byte of chunk `number` is missing."""
    cycle = make_cycle()
    whole = write_bag(cycle, first_tick=1000, metadata={'motion': 'short', 'git_revision': '0123abc'})
    cut = copy_of_killed(whole, chunks_of(whole)[number][0] - 1, tmp_path / 'killed')
    before = mcap_of(cut).read_bytes()

    with pytest.raises(BagError, match=r'has no metadata\.yaml \(the recorder was killed\); try: pkm bag-doctor'):
        read_cycle(cut)
    result = repair(cut)

    assert result.path == cut.with_name(f'{cut.name}_repaired')
    assert mcap_of(cut).read_bytes() == before, 'the damaged bag is not changed'
    record = read_cycle(result.path)
    saved = len(record.ticks)
    assert 0 < saved < 400
    assert not record.is_whole
    assert record.ticks.tolist() == list(range(1000, 1000 + saved))
    assert np.array_equal(record.error, cycle.error[:saved])
    assert record.facts == {'motion': 'short', 'git_revision': '0123abc', 'repaired_from': mcap_of(cut).name}
    for topic, ranges in result.missing.items():
        assert ranges == [(1000 + result.saved[topic], 1399)]
        assert record.expected[topic] == 400
    assert sum(result.saved.values()) == sum(1 for _ in raw_messages(result.path))


def test_damaged_chunk_loses_only_its_own_ticks(write_bag):
    bag = write_bag()
    chunks = chunks_of(bag)
    end, chunk = chunks[len(chunks) // 2]
    content = bytearray(mcap_of(bag).read_bytes())
    content[end - len(chunk.data) // 2] ^= 0xFF
    mcap_of(bag).write_bytes(content)

    with pytest.raises(BagError, match='pkm bag-doctor'):
        read_cycle(bag)
    result = repair(bag)
    assert result.damaged_chunks == 1
    [(first, last)] = result.missing['/pkm/d1/encoder']
    assert 0 < first < last < 399
    assert result.saved['/pkm/d1/encoder'] == 400 - (last - first + 1)
    with pytest.raises(BagError, match='have gaps'):
        read_cycle(result.path)


def test_cycle_that_ended_early_has_no_missing_ticks(start_recording):
    recording = start_recording()
    recording.ticks(200)
    recording.event(4, 200)  # FAULT
    bag = recording.close()
    (bag / 'metadata.yaml').unlink()
    assert set(map(tuple, repair(bag).missing.values())) == {()}


def test_intact_bag_is_not_repaired(write_bag, tmp_path):
    bag = write_bag()
    assert repair(bag) is None
    assert [path.name for path in tmp_path.iterdir()] == [bag.name]


@pytest.mark.parametrize('lost', [0, 1, 2000])
def test_lost_metadata_and_summary_are_rebuilt(write_bag, make_cycle, tmp_path, lost):
    cycle = make_cycle()
    bag = write_bag(cycle)
    again = read_cycle(repair(copy_of_killed(bag, mcap_of(bag).stat().st_size - lost, tmp_path / 'killed')).path)
    assert np.array_equal(again.error, cycle.error)
    assert again.is_whole


def test_single_file_is_repaired_into_a_folder_next_to_it(write_bag, tmp_path):
    file = tmp_path / 'alone.mcap'
    shutil.copy(mcap_of(write_bag()), file)
    assert repair(file).path == tmp_path / 'alone_repaired'


def test_repaired_bag_is_not_overwritten(write_bag):
    bag = write_bag()
    (bag / 'metadata.yaml').unlink()
    repaired = repair(bag).path
    content = mcap_of(repaired).read_bytes()
    with pytest.raises(BagError, match='_repaired: exists and is not overwritten'):
        repair(bag)
    assert mcap_of(repaired).read_bytes() == content


def foreign_bag(folder):
    """Write the bag of another project."""
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start(profile='ros2')
    schema = writer.register_schema('other_msgs/msg/Thing', 'ros2idl', b'module other {};')
    writer.add_message(writer.register_channel('/thing', 'cdr', schema), 0, bytes(8), 0)
    writer.finish()
    (folder / 'other.mcap').write_bytes(stream.getvalue())


@pytest.mark.parametrize(
    ('content', 'complaint'),
    [
        (lambda folder: None, 'has 0 MCAP files; expected 1'),
        (lambda folder: (folder / 'a.mcap').write_bytes(b''), "has no MCAP metadata record 'pkm'"),
        (lambda folder: (folder / 'a.mcap').write_text('not a bag'), "has no MCAP metadata record 'pkm'"),
        (foreign_bag, "not a bag of this cell: has no MCAP metadata record 'pkm'"),
        (shutil.rmtree, 'no such file or folder'),
    ],
)
def test_folder_without_a_bag_of_this_cell_is_refused(tmp_path, content, complaint):
    folder = tmp_path / 'bag'
    folder.mkdir()
    content(folder)
    with pytest.raises(BagError, match=complaint) as refusal:
        repair(folder)
    assert '\n' not in str(refusal.value)
    assert [path.name for path in tmp_path.iterdir()] in (['bag'], [])


def test_bag_without_an_intact_chunk_is_refused(start_recording, tmp_path):
    """The recorder was killed before its first chunk was complete."""
    recording = start_recording()
    with mcap_of(recording.bag.path).open('rb') as stream:
        next(record for record in StreamReader(stream, emit_chunks=True).records if isinstance(record, Chunk))
        size = stream.tell() - 1
    with pytest.raises(BagError, match='has no intact chunk'):
        repair(copy_of_killed(recording.bag.path, size, tmp_path / 'killed'))


def test_random_damage_never_changes_a_value(write_bag, make_cycle):
    """Random bit flips and truncations either raise a `BagError` of one line or leave all values read unchanged."""
    cycle = make_cycle()
    bag = write_bag(cycle)
    content, random = mcap_of(bag).read_bytes(), np.random.default_rng(1)
    for trial in range(20):
        damaged = bytearray(content[: random.integers(1, len(content))] if trial % 2 else content)
        damaged[random.integers(len(damaged))] ^= 1 << random.integers(8)
        mcap_of(bag).write_bytes(damaged)
        record = unless_refused(read_cycle, bag)
        assert record is None or np.array_equal(record.error, cycle.error[: len(record.error)])
        result = unless_refused(repair, bag)
        if result is not None:
            shutil.rmtree(result.path)


def unless_refused(function, bag):
    """Return the result of `function` for `bag`, or None if it raises a `BagError` of one line."""
    try:
        return function(bag)
    except BagError as refusal:
        lines = str(refusal).count('\n') + 1
    assert lines == 1
    return None
