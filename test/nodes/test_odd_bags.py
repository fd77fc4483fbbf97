"""Odd bags in the readers of the nodes: the trace of the page and `ros2 bag info`."""

import os
from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from pkm_core.bag.message_types import typestore
from pkm_core.bag.writer import BagWriter
from pkm_core.errors import BagError
from pkm_nodes.page.trace import read_trace
from pkm_nodes.ros2.bag import info

KIND = 'pkm_interfaces/msg/MotorCommand'
ONE_JOINT = SimpleNamespace(joints=('d1',), coordinates=('x',), sample_time=0.5e-3)


@pytest.fixture
def bag(tmp_path):
    """Return the folder of a bag with 300 commands of d1."""
    writer = BagWriter(tmp_path / 'bag', {'/pkm/d1/command': KIND}, {'motion': 'none'})
    for tick in range(300):
        message = typestore().types[KIND](tick=tick, cycle=1, voltage=0.1 * tick, error=1e-6, feedforward=0.0)
        writer.write('/pkm/d1/command', bytes(typestore().serialize_cdr(message, KIND)), tick)
    writer.close({})
    return writer.path


def mcap_of(folder):
    return next(folder.glob('*.mcap'))


def told(path):
    """Return what `ros2 bag info` prints as its error, or None."""
    try:
        return info(Namespace(bag_path=path, topic_name=False))
    except RuntimeError as error:
        return str(error)


def test_trace_of_a_whole_bag_is_read(bag):
    assert np.array_equal(read_trace(bag, 1, ONE_JOINT, '/pkm').voltage[:, 0], 0.1 * np.arange(300))


@pytest.mark.parametrize('damage', ['cut', 'flipped', 'pipe', 'folder', 'empty'])
def test_trace_of_a_damaged_bag_is_refused_in_one_line(bag, damage):
    file = mcap_of(bag)
    content = bytearray(file.read_bytes())
    file.unlink()
    if damage == 'pipe':
        os.mkfifo(file)
    elif damage == 'folder':
        file.mkdir()
    else:
        content[len(content) // 4] ^= 0xFF
        file.write_bytes({'cut': content[:-500], 'flipped': content, 'empty': b''}[damage])
    with pytest.raises(BagError) as refusal:
        read_trace(bag, 1, ONE_JOINT, '/pkm')
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize(
    'text',
    [
        'null',
        '5',
        'a: 2020-99-01',
        'rosbag2_bagfile_information: 3',
        'rosbag2_bagfile_information: {}',
        '[' * 500,
        '&a [*a]',
    ],
)
def test_info_of_odd_metadata_is_one_line(bag, text):
    (bag / 'metadata.yaml').write_text(text)
    assert told(bag).startswith('Exception on parsing info file: ')
    assert '\n' not in told(bag)


def test_info_of_times_beyond_any_date_has_seconds(bag, capsys):
    about = yaml.safe_load((bag / 'metadata.yaml').read_text())
    about['rosbag2_bagfile_information']['starting_time']['nanoseconds_since_epoch'] = 10**32
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(about))
    assert told(bag) is None
    assert 'Start:             (100000000000000000000000.000000000)' in capsys.readouterr().out


def test_info_of_something_else_than_a_file_is_one_line(tmp_path):
    os.mkfifo(tmp_path / 'pipe.mcap')
    assert (
        told(tmp_path / 'pipe.mcap')
        == f'No plugin detected that could open file {tmp_path}/pipe.mcap (no regular file)'
    )


def test_info_of_a_cut_file_counts_the_complete_messages(bag, capsys):
    file = mcap_of(bag)
    file.write_bytes(file.read_bytes()[:-300])
    assert told(file) is None
    assert 'Messages:          300' in capsys.readouterr().out
