"""bringup_scripts/ros2 with a node of the test; the expected texts are those of ros2cli 0.32 (Jazzy)."""

import re
import signal
import subprocess
import sys
from array import array
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.task import Future
from sensor_msgs.msg import Imu
from std_msgs.msg import Header, String
from std_srvs.srv import SetBool

from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import SampledTrajectory
from pkm_nodes.ros2.messages import message_to_csv, message_to_yaml
from pkm_nodes.ros2.timing import Intervals

ROOT = Path(__file__).resolve().parents[2]
TOOL = ROOT / 'bringup_scripts' / 'ros2'
MOTION = 'pkm_interfaces/action/ExecuteMotion'
TRAJECTORY = """\
cycle: 3
kind: 0
motion: frü...
learning_law: ''
sample_time: 1.0e-05
coordinates:
- q1
- q2
move_starts:
- 0
- 5
move_ends: []
position:
- 0.0
- 0.5
- 1.0
- '...'
velocity: []
acceleration: []
jerk: []
feedforward: []
planned: ''
geometry: ''
stay: false
offset: 0
hold: 0
---
"""


class Bench(Node):
    """A node with an endpoint for every verb."""

    def __init__(self):
        super().__init__('bench', namespace='/pkm')
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.trajectory_pub = self.create_publisher(SampledTrajectory, '/joint_trajectory', latched)
        self.trajectory_pub.publish(
            SampledTrajectory(
                cycle=3,
                motion='früh: "x"',
                sample_time=1e-5,
                coordinates=['q1', 'q2'],
                move_starts=array('I', [0, 5]),
                position=array('d', [0.5 * i for i in range(200)]),
            )
        )
        publishers = [
            self.create_publisher(String, '/chatter', 10),
            self.create_publisher(String, '/_hidden', 10),
            self.create_publisher(String, '/mixed', 10),
            self.create_publisher(String, '/mixed', qos_profile_sensor_data),
        ]
        stamped = self.create_publisher(Imu, '/stamped', 10)
        self.create_timer(0.05, lambda: stamped.publish(Imu(header=Header(stamp=self.get_clock().now().to_msg()))))
        self.create_timer(0.05, lambda: [publisher.publish(String(data='hello')) for publisher in publishers])
        self.create_service(SetBool, '/set', self.on_set)
        self.declare_parameters('', [('gain', 2.5), ('name', 'abc'), ('weights', [1.0, 2.0])])
        self.add_on_set_parameters_callback(self.on_parameters)
        self.actions = ActionServer(
            self,
            ExecuteMotion,
            '/execute_motion',
            self.on_motion,
            goal_callback=lambda goal: GoalResponse.ACCEPT if goal.cycles else GoalResponse.REJECT,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
            callback_group=ReentrantCallbackGroup(),
        )

    def on_set(self, request, response):
        response.success = request.data
        return response

    def on_parameters(self, parameters):
        if any(parameter.name == 'gain' and parameter.value > 10.0 for parameter in parameters):
            return SetParametersResult(successful=False, reason='gain must be at most 10')
        return SetParametersResult(successful=True)

    def pause(self):
        """Return a future that ends after 0.2 s."""
        ended = Future()

        def end():
            self.destroy_timer(timer)
            ended.set_result(None)

        timer = self.create_timer(0.2, end)
        return ended

    async def on_motion(self, goal):
        for cycle in range(1, goal.request.cycles + 1):
            await self.pause()  # with several threads instead, rclpy now and then forgets a cancel request
            if goal.is_cancel_requested:
                goal.canceled()
                print(f'canceled {goal.request.motion}', flush=True)
                return ExecuteMotion.Result(cycles_completed=cycle)
            goal.publish_feedback(
                ExecuteMotion.Feedback(cycle=cycle, joints=['q1'], max_dynamic_error=array('d', [1e-6]))
            )
        if goal.request.motion == 'bad':
            goal.abort()
        else:
            goal.succeed()
        return ExecuteMotion.Result(cycles_completed=goal.request.cycles)


@pytest.fixture(scope='module')
def bench(ros2_environment):
    process = subprocess.Popen([sys.executable, __file__], env=ros2_environment, stdout=subprocess.PIPE, text=True)
    try:
        assert 'ready\n' in process.stdout, 'it has ended'  # Fast DDS may write lines of its own before
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def test_message_text_has_the_format_of_ros2cli():
    imu = Imu(linear_acceleration_covariance=np.arange(9) / 4)
    assert message_to_csv(imu).endswith(',0.0,0.0,0.0,0.0,0.25,0.5,0.75,1.0,1.25,1.5,1.75,2.0')
    assert message_to_yaml(imu, no_arr=True).endswith("linear_acceleration_covariance: '<array type: double[9]>'\n")
    status = DiagnosticStatus(level=b'\x02', name='drive', values=[KeyValue(key='k')])
    assert message_to_csv(status, no_str=True) == (
        "b'\\x02',<string length: <5>>,<string length: <0>>,<string length: <0>>,"
        '<string length: <1>>,<string length: <0>>'
    )
    assert message_to_yaml(status, flow_style=True) == (
        "level: \"\\x02\"\nname: drive\nmessage: ''\nhardware_id: ''\nvalues: [{key: k, value: ''}]\n"
    )
    assert message_to_yaml(status, no_arr=True).endswith(
        "values: '<sequence type: diagnostic_msgs/msg/KeyValue, length: 1>'\n"
    )


@pytest.mark.slow
def test_lists_show_topics_and_nodes(bench, ros2):
    topics = ros2('topic', 'list', '-t').stdout.splitlines()
    assert '/joint_trajectory [pkm_interfaces/msg/SampledTrajectory]' in topics
    assert not [topic for topic in topics if topic.startswith('/_')]
    assert '/_hidden' in ros2('topic', 'list', '--include-hidden-topics').stdout.splitlines()
    assert ' * /mixed [std_msgs/msg/String] 2 publishers\n' in ros2('topic', 'list', '--verbose').stdout
    assert ros2('node', 'list').stdout == '/pkm/bench\n'
    hidden, shown = ros2('node', 'list', '-a').stdout.splitlines()
    assert hidden.startswith('/_ros2cli_')
    assert shown == '/pkm/bench'


def test_echo_prints_a_latched_message_as_yaml(bench, ros2):
    assert ros2('topic', 'echo', '/joint_trajectory', '--once', '-l', 3).stdout == TRAJECTORY


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (['--field', 'coordinates'], "['q1', 'q2']\n---\n"),
        (['pkm_interfaces/msg/SampledTrajectory', '--field', 'cycle'], '3\n---\n'),
        (['--csv', '-l', '2'], '3,0,fr...,,1e-05,q1,q2,0,5,,0.0,0.5,...,,,,,,,False,0,0\n'),
        (['--csv', '--no-arr', '--field', 'cycle'], '3\n---\n'),
    ],
)
def test_echo_selects_and_formats(bench, ros2, arguments, text):
    assert ros2('topic', 'echo', '/joint_trajectory', *arguments, '--once').stdout == text


def test_echo_abbreviates_arrays_and_strings(bench, ros2):
    text = ros2('topic', 'echo', '/joint_trajectory', '--once', '--no-arr', '--no-str').stdout
    assert "motion: '<string length: <9>>'\n" in text
    assert "coordinates: '<sequence type: string, length: 2>'\n" in text
    assert "position: '<sequence type: double, length: 200>'\n" in text


def test_echo_ends_with_its_reader(bench, ros2):
    """Its QoS matches all publishers."""
    text = ros2('topic', 'echo', '/mixed', '--once').stdout
    assert text == (
        'Some, but not all, publishers are offering QoSReliabilityPolicy.RELIABLE. '
        'Falling back to QoSReliabilityPolicy.BEST_EFFORT as it will connect to all publishers\n'
        'data: hello\n---\n'
    )
    raw = ros2('topic', 'echo', '/chatter', '--once', '--raw', '--qos-reliability', 'reliable').stdout
    assert raw == r"b'\x00\x01\x00\x00\x06\x00\x00\x00hello\x00\x00\x00'" + '\n---\n'


def test_echo_ends_quietly_on_ctrl_c_and_timeout(bench, ros2):
    assert ros2('topic', 'echo', '/chatter', until='---', code=130).stdout.startswith('data: hello\n---\n')
    assert ros2('topic', 'echo', '/silent', 'std_msgs/msg/String', '--spin-time', 0, '--timeout', 0.5).stdout == ''


def test_hz_prints_rate_percentiles_and_place_of_measurement(bench, ros2):
    result = ros2('topic', 'hz', '/chatter', '--window', 10, until='window: 10\n', code=130)
    reports = re.findall(
        r'average rate: ([\d.]+)\n\tmin: [\d.]+s max: [\d.]+s std dev: [\d.]+s window: (\d+)\n'
        r'\t50 %: (\d+)us 95 %: (\d+)us 99 %: (\d+)us\n',
        result.stdout + '\n',
    )
    assert 10.0 < float(reports[-1][0]) < 30.0  # published at 20 Hz; a busy machine bunches ten messages
    assert 0 < int(reports[-1][2]) <= int(reports[-1][3]) <= int(reports[-1][4])
    assert 'measured at this receiver' in result.stderr


def test_delay_prints_the_age_of_messages_with_percentiles(bench, ros2):
    result = ros2('topic', 'delay', '/stamped', until='us\n', code=130)
    mean, low, middle, high = map(
        float,
        re.search(
            r'average delay: (-?[\d.]+)\n\tmin: (-?[\d.]+)s max: .*\n\t50 %: (-?\d+)us 95 %: \d+us 99 %: (\d+)us\n',
            result.stdout,
        ).groups(),
    )
    assert 0.0 <= low <= mean
    assert 0.0 < middle <= high
    assert 'measured at this receiver' in result.stderr
    refused = ros2('topic', 'delay', '/chatter', code=1)
    assert 'msg does not have header' in refused.stderr


def test_echo_prints_the_intervals_at_its_end(bench, ros2):
    result = ros2('topic', 'echo', '/chatter', until='hello\n---\ndata: hello\n---\n', code=130)
    expected = r'intervals of the messages: 50 %: \d+us 95 %: \d+us 99 %: \d+us \(measured at this receiver'
    assert re.search(expected, result.stderr)


def test_rate_is_that_of_the_window():
    intervals = Intervals(4)
    reports = [intervals.count(now) for now in (0, 1_000_000_000, 1_500_000_000, 2_000_000_000)]
    assert reports == [None] * 3 + [
        'average rate: 1.500\n\tmin: 0.500s max: 1.000s std dev: 0.23570s window: 3\n'
        '\t50 %: 500000us 95 %: 950000us 99 %: 990000us'
    ]
    assert intervals.count(500) is None  # time was reset: the count restarts
    assert intervals.count(1000) is None


def test_service_call_prints_request_and_response(bench, ros2):
    text = ros2('service', 'call', '/set', 'std_srvs/srv/SetBool', '{data: true}').stdout
    assert text.removeprefix('waiting for service to become available...\n') == (
        'requester: making request: std_srvs.srv.SetBool_Request(data=True)\n\n'
        "response:\nstd_srvs.srv.SetBool_Response(success=True, message='')\n\n"
    )


def test_goal_is_followed_to_its_end(bench, ros2):
    goal = '{cycles: 1, poses: [{x: 0.1}]}'
    text = ros2('action', 'send_goal', '-f', '/execute_motion', MOTION, goal).stdout
    sent, followed = re.sub('[0-9a-f]{32}', 'ID', text).split('Goal accepted with ID: ID\n\n')
    assert sent.startswith(
        'Waiting for an action server to become available...\n'
        "Sending goal:\n     session: ''\nmotion: ''\n"
        'poses:\n- x: 0.1\n  y: 0.0\n  z: 0.0\n  phi: 0.0\nmove_time: 0.0\nrest_time: 0.0\ncycles: 1\n'
        "controller: ''\nlearning_law: ''\n"
    )
    assert followed == (
        "Feedback:\n    session: ''\ncycle: 1\njoints:\n- q1\nmax_dynamic_error:\n- 1.0e-06\n\n"
        "Result:\n    session: ''\ncycles_completed: 1\nmessage: ''\n\n"
        'Goal finished with status: SUCCEEDED\n'
    )


@pytest.mark.parametrize(
    ('goal', 'end'),
    [('{cycles: 1, motion: bad}', 'Goal finished with status: ABORTED\n'), ('{cycles: 0}', 'Goal was rejected.\n')],
)
def test_failed_goal_is_reported(bench, ros2, goal, end):
    assert ros2('action', 'send_goal', '/execute_motion', MOTION, goal).stdout.endswith(end)


def test_ctrl_c_cancels_the_goal(bench, ros2):
    goal = '{cycles: 1000, motion: long}'
    text = ros2('action', 'send_goal', '/execute_motion', MOTION, goal, until='Goal accepted', code=130).stdout
    assert text.endswith('Canceling goal...\nGoal canceled.\n')
    assert bench.stdout.readline() == 'canceled long\n'


@pytest.mark.slow
def test_parameters_are_listed_read_and_set(bench, ros2):
    assert {'  gain', '  name', '  weights'} <= set(ros2('param', 'list', '/pkm/bench').stdout.splitlines())
    assert ros2('param', 'list', '--param-type', '--filter', 'w').stdout == (
        '/pkm/bench:\n  weights (type: double array)\n'
    )
    assert ros2('param', 'get', 'pkm/bench', 'weights').stdout == 'Double values are: [1.0, 2.0]\n'
    assert ros2('param', 'set', '/pkm/bench', 'gain', '3.5').stdout == 'Set parameter successful\n'
    assert ros2('param', 'get', '/pkm/bench', 'gain').stdout == 'Double value is: 3.5\n'
    assert ros2('param', 'set', '/pkm/bench', 'gain', '11.0').stderr == (
        'Setting parameter failed: gain must be at most 10\n'
    )
    assert ros2('param', 'set', '/pkm/bench', 'name', '2024-01-01').stdout == 'Set parameter successful\n'
    assert ros2('param', 'get', '/pkm/bench', 'name', '--hide-type').stdout == '2024-01-01\n'


@pytest.mark.parametrize(
    ('arguments', 'code', 'error'),
    [
        ('nope', 2, "invalid choice: 'nope'"),
        ('topic nope', 2, "invalid choice: 'nope'"),
        ('topic echo /chatter --truncate-length -1', 2, 'value must be non-negative integer'),
        ('topic echo /nope', 1, 'Could not determine the type for the passed topic\n'),
        ('topic echo /chatter nope/msg/Nope', 1, 'The passed message type is invalid\n'),
        ('topic echo /chatter --field data.x', 1, "Invalid field 'data.x': 'str' object has no attribute 'x'\n"),
        ('topic echo /chatter --filter m.x', 1, "Invalid filter 'm.x': 'String' object has no attribute 'x'\n"),
        ('service call /set nope', 1, 'The passed service type is invalid\n'),
        ('service call /set std_srvs/srv/SetBool {nope:', 1, "Not valid YAML: '{nope:': expected the node content"),
        ('service call /set std_srvs/srv/SetBool {nope:1}', 1, 'Failed to populate field: '),
        (
            'service call /nope std_srvs/srv/SetBool',
            1,
            "No service '/nope' of type 'std_srvs/srv/SetBool' within 5.0 s\n",
        ),
        ('action send_goal /execute_motion nope', 1, 'The passed action type is invalid\n'),
        ('param get /nope gain --timeout 1', 1, 'Node not found\n'),
        ('param get /pkm/bench nope', 1, 'Parameter not set\n'),
        ('run nope nope', 1, "Package 'nope' not found\n"),
        ('run pkm_nodes nope', 1, 'No executable found\n'),
        ('bag info /nope', 2, "Bag path '/nope' does not exist!"),
    ],
)
def test_invalid_input_gives_one_line_of_error(bench, ros2, arguments, code, error):
    err = ros2(*arguments.split(' '), code=code).stderr
    assert error in err
    assert code == 2 or err.count('\n') == 1


@pytest.mark.parametrize('value', ['-1', '4294967296', 'abc'])
def test_value_of_the_wrong_type_is_refused(bench, ros2, value):
    result = ros2('action', 'send_goal', '/execute_motion', MOTION, f'{{cycles: {value}}}', code=1)
    assert result.stderr.startswith('Failed to populate message fields: ')


def test_run_becomes_the_executable(ros2):
    assert 'Usage: pkm' in ros2('run', 'pkm_core', 'pkm', '--help').stdout
    assert ros2('run', '--prefix', 'echo -n', 'pkm_core', 'pkm', '--ros-args', '-p', 'x:=1').stdout == (
        f'{ROOT}/.venv/lib/pkm_core/pkm --ros-args -p x:=1'
    )


def test_real_ros2_on_path_takes_over(ros2_environment, tmp_path):
    links, real = tmp_path / 'links', tmp_path / 'real'
    links.mkdir()
    real.mkdir()
    (links / 'ros2').symlink_to(TOOL)
    (real / 'ros2').write_text('#!/bin/sh\necho "real $# $3"; cat; exit 7\n')
    (real / 'ros2').chmod(0o755)
    result = subprocess.run(
        [links / 'ros2', 'topic', 'pub', 'a b'],
        env=ros2_environment | {'PATH': f'{links}:{TOOL.parent}:{real}:/usr/bin:/bin'},
        input='from stdin',
        capture_output=True,
        text=True,
        timeout=10,
        check=False,
    )
    assert (result.returncode, result.stdout) == (7, 'real 3 a b\nfrom stdin')


def main():
    rclpy.init()
    node = Bench()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    print('ready', flush=True)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
