"""bringup_scripts/ros2 bag info; the expected texts are those of ros2cli 0.32 (Jazzy)."""

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore


def write_bag(path):
    types = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        message_type = 'std_msgs/msg/UInt8'
        connection = writer.add_connection('/count', message_type, typestore=types)
        for i in range(3):
            data = types.serialize_cdr(types.types[message_type](data=i), message_type)
            writer.write(connection, 1_700_000_000_000_000_001 + i * 500_000_000, data)
    return path / f'{path.name}.mcap'


def bag_text(file, size, distro):
    return (
        f'\nFiles:             {file}\nBag size:          {size}\n'
        f'Storage id:        mcap\nROS Distro:        {distro}\n'
        'Duration:          1.000000000s\n'
        'Start:             Nov 14 2023 22:13:20.000000001 (1700000000.000000001)\n'
        'End:               Nov 14 2023 22:13:21.000000001 (1700000001.000000001)\n'
        'Messages:          3\n'
        'Topic information: Topic: /count | Type: std_msgs/msg/UInt8 | Count: 3 | Serialization Format: cdr\n'
        'Service:           0\nService information: \n'
    )


def test_bag_info_of_a_folder_and_of_a_file(ros2, tmp_path):
    file = write_bag(tmp_path / 'bag')
    assert file.stat().st_size > 1024
    folder_size = sum(entry.stat().st_size for entry in file.parent.iterdir()) / 1024
    assert ros2('bag', 'info', file.parent).stdout == bag_text(file.name, f'{folder_size:.1f} KiB', 'rosbags')
    assert ros2('bag', 'info', file).stdout == bag_text(file, f'{file.stat().st_size / 1024:.1f} KiB', 'unknown')
    assert ros2('bag', 'info', '-t', file).stdout == '/count\n'


def test_bag_info_of_damaged_bags(ros2, tmp_path):
    file = write_bag(tmp_path / 'bag')
    file.write_bytes(file.read_bytes()[:-40])  # the end of a killed recording: no footer
    result = ros2('bag', 'info', file)
    assert 'Messages:          3\n' in result.stdout
    assert 'no summary, as of a killed recorder' in result.stderr
    file.write_text('no bag')
    assert 'No plugin detected that could open file' in ros2('bag', 'info', file, code=1).stderr
    (tmp_path / 'bag' / 'metadata.yaml').write_text('a: [')
    assert 'Exception on parsing info file: ' in ros2('bag', 'info', tmp_path / 'bag', code=1).stderr
    assert 'Could not find metadata in bag directory' in ros2('bag', 'info', tmp_path, code=1).stderr
