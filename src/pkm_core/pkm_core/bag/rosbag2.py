"""
Metadata of a bag in the format of rosbag2 Jazzy: metadata.yaml version 9, and the metadata of a topic's channel.

Keys, order and values follow its sources: yaml.hpp and qos.cpp of rosbag2_storage, and mcap_storage.cpp of
rosbag2_storage_mcap, branch jazzy at 64717ee.
"""

from functools import cache
from typing import NamedTuple

import yaml

_FOREVER = {'sec': 9223372036, 'nsec': 854775807}  # RMW_DURATION_INFINITE
# starting_time of a bag without messages
NEVER = 2**63 - 1


class Qos(NamedTuple):
    """Quality of service of a topic as seen by a recorder; DDS does not announce a writer's history or depth."""

    reliability: str = 'reliable'
    durability: str = 'volatile'

    def written(self):
        """Return it in the form of rosbag2."""
        return {
            'history': 'unknown',
            'depth': 0,
            'reliability': self.reliability,
            'durability': self.durability,
            'deadline': _FOREVER,
            'lifespan': _FOREVER,
            'liveliness': 'automatic',
            'liveliness_lease_duration': _FOREVER,
            'avoid_ros_namespace_conventions': False,
        }


RECORDED_QOS = Qos()  # of the cell's topics


class FileFacts(NamedTuple):
    """One file of a bag."""

    name: str  # within the folder
    start: int  # time of the oldest message [ns]; NEVER without messages
    duration: int  # from the oldest to the newest message [ns]
    messages: int


class _NoAliases(yaml.CSafeDumper):  # the Python dumper takes a third of the time of a cycle
    """Writes repeated content in full; rosbag2's reader does not support aliases."""

    def ignore_aliases(self, data):
        return True


def dump(data):
    """Return `data` as YAML text with its order of keys."""
    return yaml.dump(data, Dumper=_NoAliases, sort_keys=False)


@cache
def channel_facts(type_hash, qos=RECORDED_QOS):
    """Return the metadata of the MCAP channel of a topic whose type has the RIHS01 hash `type_hash`."""
    return {'offered_qos_profiles': dump([qos.written()]).rstrip('\n'), 'topic_type_hash': type_hash}


def bag_information(files, topics, *, custom_data):
    """
    Return the content of metadata.yaml of a bag.

    Parameters
    ----------
    files : list of FileFacts
        MCAP files in order.
    topics : list of (str, str, str, int, Qos)
        Name, message type, RIHS01 hash of the type, number of messages and quality of service.
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
        'message_count': sum(count for *_, count, _ in topics),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': name,
                    'type': kind,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [qos.written()],
                    'type_description_hash': type_hash,
                },
                'message_count': count,
            }
            for name, kind, type_hash, count, qos in topics
        ],
        'compression_format': '',  # rosbag2's own compression is not used; MCAP compresses its chunks
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
