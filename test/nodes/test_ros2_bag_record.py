"""`ros2 bag record` of the substitute: bags of any topics, read by `rosbags` and by the project's own reader."""

import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from pkm_core.bag.reader import read_metadata, read_topics
from pkm_nodes.ros2.bag_recorder import define
from support.ros2_tool import ServedBench, ros2


@pytest.fixture(scope='module')
def bench(domain_id):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain_id))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        served = ServedBench(domain_id)
        yield served
        served.close()


@pytest.fixture(scope='module')
def recorded(bench, tmp_path_factory):
    """Return the bag of all topics of the bench, of two files, and what the recorder said about it."""
    bag = tmp_path_factory.mktemp('record') / 'bag'
    assert ros2('bag', 'record', '-a', '-d', 1, '-o', bag, '--custom-data', 'who=me', 'why=test', seconds=3.0) is None
    return bag


def test_bag_has_every_topic_and_its_latched_message(recorded):
    messages = read_topics(recorded)
    assert [message.data for message in messages['/chatter']] == ['hello'] * len(messages['/chatter'])
    assert len(messages['/chatter']) > 20  # 20 per second for three seconds
    assert [list(message.position) for message in messages['/joint_trajectory']] == [[1.0, 2.0]]
    assert '/_hidden' not in messages


def test_bag_is_read_by_rosbags_with_the_types_in_it(recorded):
    with AnyReader([recorded], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        found = {connection.topic: connection.msgtype for connection in reader.connections}
        texts = {
            reader.deserialize(data, connection.msgtype).data
            for connection, _, data in reader.messages(c for c in reader.connections if c.topic == '/chatter')
        }
    assert found['/joint_trajectory'] == 'pkm_interfaces/msg/SampledTrajectory'
    assert texts == {'hello'}


def test_metadata_names_files_qos_and_custom_data(recorded):
    about = read_metadata(recorded)
    assert len(about['relative_file_paths']) > 1
    assert about['custom_data'] == {'who': 'me', 'why': 'test'}
    qos = {
        topic['topic_metadata']['name']: topic['topic_metadata']['offered_qos_profiles'][0]['durability']
        for topic in about['topics_with_message_count']
    }
    assert qos['/joint_trajectory'] == 'transient_local'
    assert qos['/chatter'] == 'volatile'


def test_named_topics_are_recorded_and_missing_ones_said(bench, tmp_path, capsys):
    bag = tmp_path / 'bag'
    assert ros2('bag', 'record', '/chatter', '/nope', '-o', bag, seconds=1.5) is None
    said = capsys.readouterr().err
    assert '/nope: was not published\n' in said
    assert ' message(s) of 1 topic(s) in ' in said
    assert said.endswith('; 0 lost\n')
    assert set(read_topics(bag)) == {'/chatter'}


def test_regular_expressions_choose_topics(bench, tmp_path):
    bag = tmp_path / 'bag'
    ros2('bag', 'record', '-e', 'chat|joint', '--exclude-regex', 'joint', '-o', bag, seconds=1.0)
    assert set(read_topics(bag)) == {'/chatter'}


def test_existing_folder_is_not_touched(bench, tmp_path):
    assert ros2('bag', 'record', '-a', '-o', tmp_path) == f"Output folder '{tmp_path}' already exists."
    assert list(tmp_path.iterdir()) == []
    assert ros2('bag', 'record') == 'Need to specify one option out of --all, --topics, --regex'


def test_definition_of_a_type_comes_from_its_package():
    types = get_typestore(Stores.EMPTY)
    define(types, 'pkm_interfaces/msg/SampledTrajectory')
    define(types, 'sensor_msgs/msg/JointState')
    assert {'sensor_msgs/msg/JointState', 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'} <= set(types.fielddefs)
