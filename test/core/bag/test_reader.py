"""Bags: metadata in the format of rosbag2, and every message read back."""

import json
from os import urandom
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from pkm_core.bag.message_types import typestore
from pkm_core.bag.reader import raw_messages, read_metadata, read_topics
from pkm_core.bag.writer import BagWriter
from pkm_core.config import install_prefixes
from pkm_core.errors import BagError

# output of YAML::convert<BagMetadata> and its converters, rosbag2_storage/yaml.hpp and qos.cpp of Jazzy
BAG_KEYS = (
    *('version', 'storage_identifier', 'duration', 'starting_time', 'message_count', 'topics_with_message_count'),
    *('compression_format', 'compression_mode', 'relative_file_paths', 'files', 'custom_data', 'ros_distro'),
)
TOPIC_KEYS = ('name', 'type', 'serialization_format', 'offered_qos_profiles', 'type_description_hash')
FILE_KEYS = ('path', 'starting_time', 'duration', 'message_count')
FOREVER = {'sec': 9223372036, 'nsec': 854775807}
# a publisher of the cell by get_publishers_info_by_topic of rclpy 7.1, in the terms of rosbag2
QOS = {
    'history': 'unknown',
    'depth': 0,
    'reliability': 'reliable',
    'durability': 'volatile',
    'deadline': FOREVER,
    'lifespan': FOREVER,
    'liveliness': 'automatic',
    'liveliness_lease_duration': FOREVER,
    'avoid_ros_namespace_conventions': False,
}


def mcap_of(bag):
    return next(bag.glob('*.mcap'))


def test_metadata_has_the_fields_of_rosbag2(write_bag):
    bag = write_bag(metadata={'motion': 'short', 'git_revision': '0123abc'})
    info = yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert tuple(info) == BAG_KEYS
    assert info['version'] == 9
    assert info['storage_identifier'] == 'mcap'
    assert info['ros_distro'] == 'jazzy'
    assert (info['compression_format'], info['compression_mode']) == ('', '')
    assert info['relative_file_paths'] == [f'{bag.name}_0.mcap']
    assert tuple(info['files'][0]) == FILE_KEYS
    assert info['files'] == [{'path': f'{bag.name}_0.mcap', **{key: info[key] for key in FILE_KEYS[1:]}}]
    # ticks 0 to 399
    assert (info['starting_time'], info['duration']) == ({'nanoseconds_since_epoch': 0}, {'nanoseconds': 199_500_000})
    assert set(info['custom_data']) == {'motion', 'git_revision', 'expected'}
    assert all(isinstance(value, str) for value in info['custom_data'].values()), 'rosbag2 reads strings'
    counts = {}
    for topic in info['topics_with_message_count']:
        assert tuple(topic) == ('topic_metadata', 'message_count')
        about = topic['topic_metadata']
        assert tuple(about) == TOPIC_KEYS
        assert about['serialization_format'] == 'cdr'
        assert about['offered_qos_profiles'] == [QOS]
        assert tuple(about['offered_qos_profiles'][0]) == tuple(QOS)
        counts[about['name']] = topic['message_count']
    assert sum(counts.values()) == info['message_count']
    assert counts['/pkm/d1/encoder'] == 400
    assert '&' not in (bag / 'metadata.yaml').read_text().replace('"', ''), 'no YAML aliases'


def test_channels_and_metadata_records_match_rosbag2(write_bag):
    bag = write_bag()
    with mcap_of(bag).open('rb') as stream:
        reader = make_reader(stream)
        header, summary = reader.get_header(), reader.get_summary()
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert header.profile == 'ros2'
    hashes = {t['topic_metadata']['name']: t['topic_metadata'] for t in read_metadata(bag)['topics_with_message_count']}
    for channel in summary.channels.values():
        assert channel.message_encoding == 'cdr'
        assert list(channel.metadata) == ['offered_qos_profiles', 'topic_type_hash']
        text = channel.metadata['offered_qos_profiles']
        assert yaml.safe_load(text) == [QOS]
        # YAML::Dump ends without a line break
        assert text.startswith('- history: unknown\n  depth: 0\n')
        assert text.endswith('conventions: false')
        assert channel.metadata['topic_type_hash'] == hashes[channel.topic]['type_description_hash']
    assert {schema.encoding for schema in summary.schemas.values()} == {'ros2msg'}
    assert yaml.safe_load(metadata['rosbag2']['serialized_metadata']) == read_metadata(bag)


@pytest.mark.parametrize('kind', ['pkm_interfaces/msg/SampledTrajectory', 'geometry_msgs/msg/PoseStamped'])
def test_type_hash_equals_that_of_rosidl(kind):
    package, _, name = kind.split('/')
    files = [prefix / 'share' / package / 'msg' / f'{name}.json' for prefix in install_prefixes()]
    hashes = json.loads(next(file for file in files if file.exists()).read_text())['type_hashes']
    assert typestore().hash_rihs01(kind) == next(h['hash_string'] for h in hashes if h['type_name'] == kind)


def test_rosbags_and_mcap_read_the_written_messages(write_bag, make_cycle):
    cycle = make_cycle()
    bag = write_bag(cycle)
    with AnyReader([bag]) as reader:
        raw = reader.messages([c for c in reader.connections if c.topic == '/pkm/d3/command'])
        by_rosbags = [(time, reader.deserialize(data, c.msgtype).voltage) for c, time, data in raw]
    with mcap_of(bag).open('rb') as stream:
        messages = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(['/pkm/d3/command'])
        by_mcap = [(raw.log_time, message.voltage) for _, _, raw, message in messages]
    written = list(zip(range(0, 400 * 500_000, 500_000), cycle.voltage[:, 1], strict=True))
    assert by_rosbags == by_mcap == written
    ours = read_topics(bag, ['/pkm/d3/command'])['/pkm/d3/command']
    assert [message.voltage for message in ours] == cycle.voltage[:, 1].tolist()


def test_start_time_is_that_of_the_oldest_message(tmp_path):
    bag = BagWriter(tmp_path / 'bag', {'/a': 'std_msgs/msg/UInt32'}, {})
    data = bytes(typestore().serialize_cdr(typestore().types['std_msgs/msg/UInt32'](data=1), 'std_msgs/msg/UInt32'))
    for time in (70, 50, 60):
        bag.write('/a', data, time)
    bag.close({})
    info = read_metadata(bag.path)
    assert info['starting_time'] == {'nanoseconds_since_epoch': 50}
    assert info['duration'] == {'nanoseconds': 20}
    assert [time for *_, time in raw_messages(bag.path)] == [50, 60, 70]


def test_topic_without_messages_is_read_as_an_empty_list(write_bag):
    assert read_topics(write_bag(), ['/pkm/pose', '/pkm/nothing']) == {'/pkm/pose': [], '/pkm/nothing': []}


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [('{', 'cannot be read as the metadata'), ('other: 1', 'rosbag2_bagfile_information'), ('[]', 'metadata')],
)
def test_invalid_metadata_file_is_refused(write_bag, text, complaint):
    bag = write_bag()
    (bag / 'metadata.yaml').write_text(text)
    with pytest.raises(BagError, match=complaint) as refusal:
        read_metadata(bag)
    assert '\n' not in str(refusal.value)


def test_existing_bag_is_not_overwritten(write_bag):
    bag = write_bag()
    with pytest.raises(FileExistsError):
        BagWriter(bag, {}, {})
    assert Path(bag).exists()


def test_split_bag_is_read_as_one(tmp_path):
    """Both by `read_topics` and by rosbags."""
    kind = 'std_msgs/msg/UInt32'
    bag = BagWriter(tmp_path / 'bag', {'/a': kind, '/b': kind}, {'motion': 'none'})
    for number in range(30):
        if number in (10, 20):
            bag.split()
        message = typestore().types[kind](data=number)
        bag.write('/a' if number % 3 else '/b', bytes(typestore().serialize_cdr(message, kind)), number)
    bag.close({'end': 'finished'})
    info = read_metadata(bag.path)
    assert info['relative_file_paths'] == ['bag_0.mcap', 'bag_1.mcap', 'bag_2.mcap']
    assert [file['message_count'] for file in info['files']] == [10, 10, 10]
    assert [file['starting_time']['nanoseconds_since_epoch'] for file in info['files']] == [0, 10, 20]
    assert (info['message_count'], info['duration']) == (30, {'nanoseconds': 29})
    assert info['custom_data'] == {'motion': 'none', 'end': 'finished'}
    assert [time for *_, time in raw_messages(bag.path)] == list(range(30))
    assert [message.data for message in read_topics(bag.path)['/b']] == list(range(0, 30, 3))
    with AnyReader([bag.path]) as reader:
        assert [time for _, time, _ in reader.messages()] == list(range(30))
    for file in bag.path.glob('*.mcap'):
        with file.open('rb') as stream:
            assert {record.name for record in make_reader(stream).iter_metadata()} >= {'pkm', 'rosbag2'}, file


def test_folder_with_files_of_several_bags_is_refused(write_bag):
    bag = write_bag()
    (bag / 'other.mcap').touch()
    with pytest.raises(BagError, match=r'not a bag of this cell: has 2 MCAP files; expected 1, or NAME_0\.mcap'):
        list(raw_messages(bag))


def test_closing_a_bag_detects_data_damaged_on_disk(tmp_path):
    bag = BagWriter(tmp_path / 'bag', {'/a': 'std_msgs/msg/UInt32'}, {})
    for time in range(5000):
        bag.write('/a', urandom(200), time)
    file = mcap_of(bag.path)
    with file.open('r+b') as stream:  # a disk that returns other data
        stream.seek(file.stat().st_size // 2)
        stream.write(bytes(64))
    with pytest.raises(BagError, match=r'bag_0.mcap: '):
        bag.close({})
