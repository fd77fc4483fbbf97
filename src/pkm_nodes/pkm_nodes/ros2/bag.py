"""`ros2 bag info`; `record` is in bag_record.py."""

import argparse
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Channel, Schema

from pkm_core.mcap_records import McapFile
from pkm_core.yaml_text import LONGEST_WRITTEN, YamlError, parse_written, read_text
from pkm_nodes.ros2 import bag_record
from pkm_nodes.ros2.shared import add_commands

SERVICE_TOPIC = '/_service_event'  # the end of the topic on which a service's calls are recorded
SERVICE_TYPE = '_Event'  # the end of its type


@dataclass
class Topic:
    """One topic of a bag."""

    name: str
    type: str
    count: int
    encoding: str

    @property
    def is_service(self):
        """Whether it has the calls of a service."""
        return self.name.endswith(SERVICE_TOPIC) and self.type.endswith(SERVICE_TYPE) and '/srv/' in self.type


@dataclass
class Bag:
    """Metadata of a bag."""

    files: list[str]
    size: int  # [bytes]
    storage: str
    distro: str
    start: int  # [ns] since 1970
    duration: int  # [ns]
    messages: int
    topics: list[Topic]


def add_arguments(parser):
    """Add the verbs of `ros2 bag`."""
    verbs = add_commands(
        parser,
        {
            'info': 'Print information about a bag to the screen',
            'record': 'Record ROS data to a bag',
        },
    )
    bag_record.add_arguments(verbs['record'])
    verb = verbs['info']
    verb.set_defaults(main=info)
    verb.add_argument('bag_path', type=_existing, help='Bag to open')
    verb.add_argument(
        '-s', '--storage', choices=['mcap', 'sqlite3'], help='For compatibility; the storage is always detected.'
    )
    verb.add_argument('-t', '--topic-name', action='store_true', help='Only display topic names.')


def _existing(path):
    if not Path(path).exists():
        raise argparse.ArgumentTypeError(f"Bag path '{path}' does not exist!")
    return Path(path)


def info(args):
    """Print the metadata of a bag folder or an MCAP file."""
    path = args.bag_path
    if (path / 'metadata.yaml').exists():
        bag = read_folder(path)
    elif path.is_dir():
        return f'Could not find metadata in bag directory {path}'
    elif not path.is_file():
        return f'No plugin detected that could open file {path} (no regular file)'
    else:
        bag = read_mcap(path)
    if args.topic_name:
        for topic in bag.topics:
            if not topic.is_service:
                print(topic.name)
    else:
        print(describe(bag))
    return None


def read_folder(path):
    """Return the Bag of a rosbag2 folder, from its metadata.yaml."""
    try:
        text = read_text(path / 'metadata.yaml', LONGEST_WRITTEN)
        about = parse_written(text)['rosbag2_bagfile_information']
        return Bag(
            files=[str(name) for name in about['relative_file_paths']],
            size=sum(file.stat().st_size for file in path.iterdir() if file.is_file()),
            storage=about['storage_identifier'],
            distro=about.get('ros_distro', ''),
            start=int(about['starting_time']['nanoseconds_since_epoch']),
            duration=int(about['duration']['nanoseconds']),
            messages=int(about['message_count']),
            topics=[
                Topic(str(meta['name']), str(meta['type']), int(entry['message_count']), meta['serialization_format'])
                for entry in about['topics_with_message_count']
                for meta in [entry['topic_metadata']]
            ],
        )
    except (YamlError, OSError, KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        reason = str(error) if isinstance(error, YamlError) else f'not the metadata of a bag ({error!r})'
        raise RuntimeError(f'Exception on parsing info file: {reason[:300]}') from error


def read_mcap(path):
    """Return the Bag of an MCAP file, from its summary; without one, as of a killed recorder, from its messages."""
    with path.open('rb') as stream:
        mcap, distros = McapFile(stream), []
        try:
            summary = mcap.summary()
            stats, schemas, channels = summary.statistics, summary.schemas, summary.channels
            start, end, counts = stats.message_start_time, stats.message_end_time, stats.channel_message_counts
            distros = [record.metadata.get('ROS_DISTRO', '') for record in mcap.metadata(summary)]
        except Exception:  # damage shows in many ways: a bad magic, an end of file, a failed decompression ...
            schemas, channels, counts, start, end = _scan(path, McapFile(stream))
    return Bag(
        files=[str(path)],
        size=path.stat().st_size,
        storage='mcap',
        distro=next(filter(None, distros), ''),
        start=start,
        duration=end - start,
        messages=sum(counts.values()),
        topics=[
            Topic(channel.topic, _kind(schemas, channel), counts.get(key, 0), channel.message_encoding)
            for key, channel in sorted(channels.items())
        ],
    )


def _kind(schemas, channel):
    """Return the type of the messages of `channel`, '' without a schema."""
    return schemas[channel.schema_id].name if channel.schema_id in schemas else ''


def _scan(path, mcap):
    """Return schemas, channels, message counts, first and last time [ns] of the complete records of an MCAP file."""
    schemas, channels, counts, times = {}, {}, Counter(), []
    try:
        for record in mcap.contents():
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            else:
                counts[record.channel] += 1
                times = [min([record.time, *times]), max([record.time, *times])]
    except Exception as error:  # as above; the complete records end here
        if not counts:
            raise RuntimeError(f'No plugin detected that could open file {path} ({type(error).__name__})') from error
    print(f'{path}: no summary, as of a killed recorder; counted the complete messages', file=sys.stderr)
    return schemas, channels, counts, *(times or (0, 0))


def describe(bag):
    """Return the output of `ros2 bag info`."""
    topics, services = [], []
    for topic in bag.topics:
        kind, count = ('Service', 'Event Count') if topic.is_service else ('Topic', 'Count')
        (services if topic.is_service else topics).append(
            f'{kind}: {topic.name.removesuffix(SERVICE_TOPIC)} | Type: {topic.type.removesuffix(SERVICE_TYPE)} | '
            f'{count}: {topic.count} | Serialization Format: {topic.encoding}'
        )
    calls = sum(topic.count for topic in bag.topics if topic.is_service)
    return (
        f'\nFiles:             {_below(bag.files, 19)}\n'
        f'Bag size:          {_size(bag.size)}\n'
        f'Storage id:        {bag.storage}\n'
        f'ROS Distro:        {bag.distro or "unknown"}\n'
        f'Duration:          {_seconds(bag.duration)}s\n'
        f'Start:             {_date(bag.start)}\n'
        f'End:               {_date(bag.start + bag.duration)}\n'
        f'Messages:          {bag.messages - calls}\n'
        f'Topic information: {_below(topics, 19)}\n'
        f'Service:           {len(services)}\n'
        f'Service information: {_below(services, 21)}'
    ) + ('\n' if services else '')


def _below(lines, column):
    return f'\n{" " * column}'.join(lines)


def _size(size):
    units = iter(('B', 'KiB', 'MiB', 'GiB', 'TiB'))
    unit = next(units)
    while size >= 1024 and unit != 'TiB':
        size, unit = size / 1024, next(units)
    return f'{size:.{0 if unit == "B" else 1}f} {unit}'


def _seconds(nanoseconds):
    return f'{nanoseconds // 10**9}.{nanoseconds % 10**9:09d}'


def _date(nanoseconds):
    try:
        day, clock = time.strftime('%b %e %Y|%H:%M:%S', time.localtime(nanoseconds // 10**9)).split('|')
    except (OverflowError, OSError, ValueError):  # beyond what a date can be
        return f'({_seconds(nanoseconds)})'
    return f'{day} {clock}.{nanoseconds % 10**9:09d} ({_seconds(nanoseconds)})'
