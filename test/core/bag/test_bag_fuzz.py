"""
Seeded fuzz of everything that reads a bag: a damaged or crafted one is read or refused in one line, and never whole.

Bags of the recorder have checksums everywhere. Crafted bags have none: their damage reaches the messages themselves.
"""

import random
import shutil

import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.integrity import is_whole
from pkm_core.bag.reader import raw_messages
from pkm_core.bag.repair import repair
from pkm_core.errors import PkmError

LONGEST = 500  # characters of a refusal, with two paths
ODD_NUMBERS = [0, 1, 22, 255, 2**16 - 1, 2**31, 2**32 - 1, 2**40, 2**63, 2**64 - 1]
ODD_VALUES = ['null', '~', '-1', '1e99', '.nan', '2020-99-01', '[]', '{}', '!!int x', '*a', '&a 1', '"\\0"', '9' * 5000]


@pytest.fixture(scope='module')
def bag(tmp_path_factory, start_recording_in, make_cycle):
    """Return the folder of a bag of 30 ticks, a cycle that a safe stop ended."""
    facts = {'motion': 'short', 'machine': 'planar'}
    recording = start_recording_in(tmp_path_factory.mktemp('fuzz'), make_cycle('planar'), metadata=facts)
    recording.ticks(30)
    return recording.close()


@pytest.fixture(scope='module')
def crafted(bag, tmp_path_factory):
    """Return the same bag, written without compression and checksums."""
    copy = tmp_path_factory.mktemp('crafted') / bag.name
    shutil.copytree(bag, copy)
    with mcap_of(bag).open('rb') as source, mcap_of(copy).open('wb') as stream:
        writer = Writer(stream, compression=CompressionType.NONE, enable_crcs=False)
        writer.start(profile='ros2')
        reader, numbers = make_reader(source), {}
        for schema, channel, message in reader.iter_messages():
            if channel.topic not in numbers:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.topic] = writer.register_channel(channel.topic, 'cdr', number)
            writer.add_message(numbers[channel.topic], message.log_time, message.data, message.publish_time)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        writer.finish()
    return copy


def mcap_of(folder):
    return next(folder.glob('*.mcap'))


def flipped(data, draw):
    """Return `data` with one to three bits turned."""
    data = bytearray(data)
    for _ in range(draw.randint(1, 3)):
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    return bytes(data)


def cut(data, draw):
    """Return `data` without its end, or without a part of its middle."""
    at = draw.randrange(len(data))
    return data[:at] + (b'' if draw.random() < 0.5 else data[at + draw.randint(1, 200) :])


def odd_number(data, draw):
    """Return `data` with one odd number of 2, 4 or 8 bytes somewhere: a length, a count, an offset, a time."""
    size = draw.choice([2, 4, 8])
    number = (draw.choice(ODD_NUMBERS) % 2 ** (8 * size)).to_bytes(size, 'little')
    at = draw.randrange(len(data) - size)
    return data[:at] + number + data[at + size :]


DAMAGES = [flipped, cut, odd_number]


def read_or_refused(read, folder):
    """Return the result of `read` and None, or None and its refusal, which must be one short line."""
    try:
        return read(folder), None
    except PkmError as error:
        refusal = str(error)
    assert '\n' not in refusal
    assert len(refusal) < LONGEST
    return None, refusal


def use(folder):
    """Use a bag as the verbs do; return whether the doctor called it whole."""
    record, _ = read_or_refused(read_cycle, folder)
    if record is not None and record.is_whole:
        record.metrics()
    read_or_refused(lambda path: list(raw_messages(path, ['/pkm/d1/command'])), folder)
    repaired, refusal = read_or_refused(repair, folder)
    if repaired is not None:
        shutil.rmtree(repaired.path)
    return repaired is None and refusal is None


def copies(bag, folder, seeds):
    """Yield (random numbers, new copy of `bag`) for each of `seeds`."""
    for seed in seeds:
        copy = folder / f'{bag.name}_{seed}'
        shutil.copytree(bag, copy)
        print('seed', seed)  # shown if the test fails
        yield random.Random(seed), copy


@pytest.mark.parametrize('damage', DAMAGES)
def test_damaged_bag_is_never_called_whole(bag, tmp_path, damage):
    for draw, copy in copies(bag, tmp_path, range(40)):
        content = mcap_of(copy).read_bytes()
        damaged = damage(content, draw)
        mcap_of(copy).write_bytes(damaged)
        assert use(copy) == (damaged == content)


@pytest.mark.parametrize('damage', DAMAGES)
def test_crafted_bag_is_read_or_refused(crafted, tmp_path, damage):
    for draw, copy in copies(crafted, tmp_path, range(60)):
        mcap_of(copy).write_bytes(damage(mcap_of(copy).read_bytes(), draw))
        use(copy)


def odd_value(data, draw):
    """Return YAML with one value replaced."""
    lines = data.decode().splitlines()
    number = draw.randrange(len(lines))
    lines[number] = lines[number].partition(':')[0] + ': ' + draw.choice(ODD_VALUES)
    return '\n'.join(lines).encode()


@pytest.mark.parametrize('damage', [odd_value, flipped, cut])
def test_damaged_metadata_is_never_called_whole(bag, tmp_path, damage):
    whole = yaml.safe_load((bag / 'metadata.yaml').read_text())
    for draw, copy in copies(bag, tmp_path, range(25)):
        file = copy / 'metadata.yaml'
        file.write_bytes(damage(file.read_bytes(), draw))
        try:
            same = yaml.safe_load(file.read_text()) == whole
        except (ValueError, AttributeError, yaml.YAMLError):
            same = False
        assert use(copy) == same


def test_repaired_bag_is_whole_and_read_by_mcap_and_rosbags(bag, tmp_path):
    """The bag of a killed recorder: no metadata, no summary, the last chunk cut."""
    copy = tmp_path / bag.name
    copy.mkdir()
    (copy / mcap_of(bag).name).write_bytes(mcap_of(bag).read_bytes()[:-3000])
    result = repair(copy)
    assert is_whole(result.path)
    with mcap_of(result.path).open('rb') as stream:
        by_mcap = [(channel.topic, message.data) for _, channel, message in make_reader(stream).iter_messages()]
    with AnyReader([result.path]) as reader:
        by_rosbags = [(connection.topic, bytes(data)) for connection, _, data in reader.messages()]
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
    assert len(by_mcap) == sum(result.saved.values()) > 0
    assert sorted(by_rosbags) == sorted(by_mcap)
