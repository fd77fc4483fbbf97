"""
What rosbag2 of Jazzy writes around the messages of a bag: metadata.yaml version 9 and the facts of a topic's channel.

Keys, their order and their words are those of its sources: rosbag2_storage's yaml.hpp and qos.cpp, and
rosbag2_storage_mcap's mcap_storage.cpp, branch jazzy at 64717ee.
"""

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


class _NoAliases(yaml.SafeDumper):
    """Writes what stands twice twice; rosbag2's reader knows no aliases."""

    def ignore_aliases(self, data):
        return True


def dump(data):
    """Return `data` as YAML text, keys in their order."""
    return yaml.dump(data, Dumper=_NoAliases, sort_keys=False)


def channel_facts(type_hash):
    """Return the metadata of the MCAP channel of a topic whose type has the RIHS01 hash `type_hash`."""
    return {'offered_qos_profiles': dump([_QOS]).rstrip('\n'), 'topic_type_hash': type_hash}


def bag_information(file, topics, *, start, duration, custom_data):
    """
    Return the content of metadata.yaml of a bag of one MCAP file.

    Parameters
    ----------
    file : str
        Name of the file within the folder.
    topics : list of (str, str, str, int)
        Name, message type, RIHS01 hash of the type and number of messages.
    start, duration : int
        Time of the oldest message, and from there to the newest [ns].
    custom_data : dict of str to str
        Facts of the recording.

    """
    extent = {
        'duration': {'nanoseconds': duration},
        'starting_time': {'nanoseconds_since_epoch': start},
        'message_count': sum(count for *_, count in topics),
    }
    return {
        'version': 9,
        'storage_identifier': 'mcap',
        **extent,
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
        'relative_file_paths': [file],
        'files': [
            {
                'path': file,
                'starting_time': extent['starting_time'],
                'duration': extent['duration'],
                'message_count': extent['message_count'],
            }
        ],
        'custom_data': custom_data,
        'ros_distro': 'jazzy',
    }
