"""The substitute of `ros2`: topic, service, action and node; the expected texts are those of ros2cli 0.32 (Jazzy)."""

import re

import pytest

from pkm_nodes.ros2.bw import bandwidth
from support.ros2_tool import ServedBench, ros2

SPIN = ('--spin-time', 1)  # two processes of one computer find each other within 0.1 s


@pytest.fixture(scope='module')
def bench(domain_id):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain_id))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        served = ServedBench(domain_id)
        yield served
        served.close()


@pytest.fixture
def said(bench, capsys):
    """Run a command line and return what it prints; its status must be `code`."""

    def run(*words, code=None, **options):
        assert ros2(*words, **options) == code
        return capsys.readouterr().out

    return run


def test_topic_type_and_info_print_what_the_graph_has(said):
    assert said('topic', 'type', '/chatter', code=0) == 'std_msgs/msg/String\n'
    assert said('topic', 'type', '/nope', *SPIN, code=1) == ''
    assert said('topic', 'info', '/chatter', *SPIN) == (
        'Type: std_msgs/msg/String\nPublisher count: 1\nSubscription count: 0\n'
    )
    assert said('topic', 'info', '/nope', *SPIN, code="Unknown topic '/nope'") == ''


def test_topic_info_names_every_endpoint_with_its_qos(said):
    text = said('topic', 'info', '-v', '/joint_trajectory', *SPIN)
    assert text.startswith('Type: pkm_interfaces/msg/SampledTrajectory\n\nPublisher count: 1\n\nNode name: bench\n')
    assert 'Node namespace: /pkm\n' in text
    assert '  Durability: TRANSIENT_LOCAL\n' in text
    assert text.endswith('Subscription count: 0\n\n')


def test_pub_sends_a_stamped_message_a_number_of_times(bench, said):
    text = said('topic', 'pub', '-t', 2, '-r', 50, '/stamped', 'std_msgs/msg/Header', '{stamp: now, frame_id: a}')
    text = text.removeprefix('Waiting for at least 1 matching subscription(s)...\n')
    assert re.sub(r'\d{2,}', 'N', text) == (
        'publisher: beginning loop\n'
        "publishing #1: std_msgs.msg.Header(stamp=builtin_interfaces.msg.Time(sec=N, nanosec=N), frame_id='a')\n\n"
        "publishing #2: std_msgs.msg.Header(stamp=builtin_interfaces.msg.Time(sec=N, nanosec=N), frame_id='a')\n\n"
    )
    assert [message.frame_id for message in bench.node.heard] == ['a', 'a']
    assert bench.node.heard[0].stamp.sec > 1_700_000_000


@pytest.mark.parametrize(
    ('words', 'refusal'),
    [
        (('/a', 'std_msgs/msg/String', '[1]'), 'The passed value needs to be a dictionary in YAML format'),
        (('/a', 'std_msgs/msg/String', '{nope: 1}'), 'Failed to populate field: '),
        (
            ('-1', '--max-wait-time-secs', 0.2, '/a', 'std_msgs/msg/String'),
            'Timed out waiting for subscribers: Expected 1 subscribers but only got 0 subscribers',
        ),
    ],
)
def test_pub_refuses_what_it_cannot_send(bench, words, refusal):
    assert ros2('topic', 'pub', *words).startswith(refusal)


def test_pub_refuses_an_unknown_type(bench):
    with pytest.raises(RuntimeError, match='The passed message type is invalid'):
        ros2('topic', 'pub', '/a', 'nope/msg/Nope')


def test_bandwidth_is_printed_once_per_second(said):
    text = said('topic', 'bw', '/chatter', seconds=2.5, code=130)
    assert text.startswith('Subscribed to [/chatter]\n')
    rate, size = re.search(
        r'([\d.]+) B/s from \d+ messages\n\tMessage size mean: (\d+) B min: \d+ B max: \d+ B\n', text
    ).groups()
    assert size == '14'  # 4 bytes of header, 4 of length, 6 of text
    assert 50 < float(rate) < 600  # 20 messages per second; a busy computer bunches them


@pytest.mark.parametrize(
    ('sizes', 'text'),
    [
        ([], ''),
        ([10], ''),
        ([10, 30], '40 B/s from 2 messages\n\tMessage size mean: 20 B min: 10 B max: 30 B'),
        ([1000, 3000], '4.00 KB/s from 2 messages\n\tMessage size mean: 2.00 KB min: 1.00 KB max: 3.00 KB'),
        ([2e6, 2e6], '4.00 MB/s from 2 messages\n\tMessage size mean: 2.00 MB min: 2.00 MB max: 2.00 MB'),
    ],
)
def test_bandwidth_has_the_unit_of_its_size(sizes, text):
    received = [(number * 500_000_000, size) for number, size in enumerate(sizes)]
    assert bandwidth(received, 1_000_000_000) == text


def test_services_are_listed_with_type_and_endpoints(said):
    assert '/set [std_srvs/srv/SetBool]\n' in said('service', 'list', '-t', *SPIN)
    assert said('service', 'list', '-c', *SPIN) == '8\n'  # six of its parameters, that of its types, /set
    assert said('service', 'type', '/set', code=0) == 'std_srvs/srv/SetBool\n'
    assert said('service', 'info', '/set', *SPIN) == 'Type: std_srvs/srv/SetBool\nClients count: 1\nServices count: 1\n'


def test_actions_are_listed_with_type_and_nodes(said):
    kind = 'pkm_interfaces/action/ExecuteMotion'
    assert said('action', 'list', '-t', *SPIN) == f'/execute_motion [{kind}]\n'
    assert said('action', 'type', '/execute_motion', code=0) == f'{kind}\n'
    assert said('action', 'info', '-t', '/execute_motion', *SPIN) == (
        f'Action: /execute_motion\nAction clients: 1\n    /pkm/bench [{kind}]\n'
        f'Action servers: 1\n    /pkm/bench [{kind}]\n'
    )
    assert said('action', 'info', '-c', '/nope', *SPIN) == 'Action: /nope\nAction clients: 0\nAction servers: 0\n'


def test_node_info_lists_the_endpoints_of_a_node(said):
    text = said('node', 'info', '/pkm/bench', *SPIN)
    assert text.startswith('/pkm/bench\n  Subscribers:\n    /stamped: std_msgs/msg/Header\n  Publishers:\n')
    assert '    /chatter: std_msgs/msg/String\n' in text
    assert '/_hidden' not in text
    assert '  Service Clients:\n    /set: std_srvs/srv/SetBool\n' in text
    assert '  Action Servers:\n    /execute_motion: pkm_interfaces/action/ExecuteMotion\n' in text
    assert '    /_hidden: ' in said('node', 'info', '--include-hidden', '/pkm/bench', *SPIN)
    assert said('node', 'info', '/nope', *SPIN, code="Unable to find node '/nope'") == ''


def test_parameters_are_described_dumped_and_loaded(said, tmp_path, capsys):
    assert said('param', 'describe', '/pkm/bench', 'gain', 'name') == (
        'Parameter name: gain\n  Type: double\n  Description: of the loop\n  Constraints:\n'
        '    Min value: 0.0\n    Max value: 10.0\n    Step: 0.5\n'
        'Parameter name: name\n  Type: string\n  Constraints:\n    Read only: true\n'
    )
    text = said('param', 'dump', '/pkm/bench')
    assert text.startswith(
        '/pkm/bench:\n  ros__parameters:\n    gain: 2.5\n    limits:\n      upper:\n      - 1.0\n      - 2.0\n'
    )
    file = tmp_path / 'parameters.yaml'
    wanted = 'gain: 3.5\n    limits:\n      upper: [1.0, 2.0, 3.0]\n'
    file.write_text(f'/pkm/bench:\n  ros__parameters:\n    {wanted}')
    assert ros2('param', 'load', '/pkm/bench', file) is None
    out, err = capsys.readouterr()
    assert out == 'Set parameter gain successful\n'
    assert err == 'Set parameter limits.upper failed: two limits expected\n'
    assert 'gain: 3.5\n' in said('param', 'dump', '/pkm/bench')
    file.write_text('/**:\n  ros__parameters:\n    gain: 4.0\n')
    assert said('param', 'load', 'pkm/bench', file) == 'Set parameter gain successful\n'


@pytest.mark.parametrize('text', ['[1', 'a', '{/pkm/bench: 3}', '{}'])
def test_odd_parameter_file_is_refused_in_one_line(bench, tmp_path, text):
    file = tmp_path / 'parameters.yaml'
    file.write_text(text)
    try:
        refusal = ros2('param', 'load', '/pkm/bench', file)
    except RuntimeError as error:
        refusal = str(error)
    assert refusal
    assert '\n' not in refusal


def test_doctor_passes_a_graph_and_reports_it(said):
    assert said('doctor', *SPIN) == '\nAll 4 checks passed\n\n'
    assert said('doctor', *SPIN, '-iw', code=1) == '\n1/4 check(s) failed\n\nFailed modules: topic\n'
    text = said('doctor', *SPIN, '--report')
    assert re.search(r'\n   TOPIC LIST\n(.*\n)*topic +: /chatter\npublisher count +: 1\nsubscriber count +: 0\n', text)
    assert re.search(r'\n   NODE LIST\nnode +: /pkm/bench\n', text)
