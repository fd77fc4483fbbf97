"""
What rosbag2 of Jazzy writes around the messages of a bag: metadata.yaml version 9 and the facts of a topic's channel.

Keys, their order and their words are those of its sources: rosbag2_storage's yaml.hpp and qos.cpp, and
rosbag2_storage_mcap's mcap_storage.cpp, branch jazzy at 64717ee.
"""

from functools import cache
from typing import NamedTuple

import yaml

_FOREVER = {'sec': 9223372036, 'nsec': 854775807}  # RMW_DURATION_INFINITE
# starting_time of a bag without messages
NEVER = 2**63 - 1
# What the topics of the cell are offered with, as a recorder sees it: DDS tells nobody history and depth of a writer.
_QOS = {
    'history': 'unknown',
    'depth': 0,
    'reliability': 'reliable',
    'durability': 'volatile',
    'deadline': _FOREVER,
    'lifespan': _FOREVER,
    'liveliness': 'automatic',
    'liveliness_lease_duration': _FOREVER,
    'avoid_ros_namespace_conventions': False,
}


class FileFacts(NamedTuple):
    """One file of a bag."""

    name: str  # within the folder
    start: int  # time of the oldest message [ns], NEVER without one
    duration: int  # from there to the newest [ns]
    messages: int


class _NoAliases(yaml.CSafeDumper):  # the one in Python takes as long as a third of a cycle
    """Writes what stands twice twice; rosbag2's reader knows no aliases."""

    def ignore_aliases(self, data):
        return True


def dump(data):
    """Return `data` as YAML text, keys in their order."""
    return yaml.dump(data, Dumper=_NoAliases, sort_keys=False)


@cache
def channel_facts(type_hash):
    """Return the metadata of the MCAP channel of a topic whose type has the RIHS01 hash `type_hash`."""
    return {'offered_qos_profiles': dump([_QOS]).rstrip('\n'), 'topic_type_hash': type_hash}


def bag_information(files, topics, *, custom_data):
    """
    Return the content of metadata.yaml of a bag.

    Parameters
    ----------
    files : list of FileFacts
        Its MCAP files in their order.
    topics : list of (str, str, str, int)
        Name, message type, RIHS01 hash of the type and number of messages.
    custom_data : dict of str to str
        Facts of the recording.

    """
    start = min(file.start for file in files)
    duration = max((file.start + file.duration - start for file in files if file.messages), default=0)
    return {
        'version': 9,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': duration},
        'starting_time': {'nanoseconds_since_epoch': start},
        'message_count': sum(count for *_, count in topics),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': name,
                    'type': kind,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [_QOS],
                    'type_description_hash': type_hash,
                },
                'message_count': count,
            }
            for name, kind, type_hash, count in topics
        ],
        'compression_format': '',  # of rosbag2's own compression; the chunks of the file are MCAP's business
        'compression_mode': '',
        'relative_file_paths': [file.name for file in files],
        'files': [
            {
                'path': file.name,
                'starting_time': {'nanoseconds_since_epoch': file.start},
                'duration': {'nanoseconds': file.duration},
                'message_count': file.messages,
            }
            for file in files
        ],
        'custom_data': custom_data,
        'ros_distro': 'jazzy',
    }
