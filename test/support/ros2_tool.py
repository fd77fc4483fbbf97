"""The substitute of `ros2`, called in the process of the test, beside a node that another thread serves."""

import os
import signal
import threading
from array import array

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.action import ActionClient, ActionServer
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Header, String
from std_srvs.srv import SetBool

from pkm_core.interrupts import Interrupted, interruptible
from pkm_interfaces.action import ExecuteMotion
from pkm_interfaces.msg import SampledTrajectory
from pkm_nodes.ros2.__main__ import make_parser


class Bench(Node):
    """A node with an endpoint for every command: 20 messages per second on /chatter, a latched trajectory."""

    def __init__(self, context):
        super().__init__('bench', namespace='/pkm', context=context)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._latched = self.create_publisher(SampledTrajectory, '/joint_trajectory', latched)
        self._latched.publish(SampledTrajectory(cycle=3, position=array('d', [1.0, 2.0])))
        self._chatter = self.create_publisher(String, '/chatter', 10)
        self._status = self.create_publisher(DiagnosticStatus, '/_hidden', 10)
        self.create_timer(0.05, lambda: self._chatter.publish(String(data='hello')))
        self.heard = []
        self.create_subscription(Header, '/stamped', self.heard.append, 10)
        self.create_service(SetBool, '/set', lambda request, response: response)
        self._caller = self.create_client(SetBool, '/set')
        ExecuteMotion.Result()
        self._server = ActionServer(self, ExecuteMotion, '/execute_motion', lambda goal: ExecuteMotion.Result())
        self._goals = ActionClient(self, ExecuteMotion, '/execute_motion')
        bounds = [FloatingPointRange(from_value=0.0, to_value=10.0, step=0.5)]
        self.declare_parameter('gain', 2.5, ParameterDescriptor(description='of the loop', floating_point_range=bounds))
        self.declare_parameter('limits.upper', [1.0, 2.0])
        self.declare_parameter('name', 'abc', ParameterDescriptor(read_only=True))
        self.add_on_set_parameters_callback(self._check)

    def _check(self, parameters):
        refused = any(parameter.name == 'limits.upper' and len(parameter.value) > 2 for parameter in parameters)
        return SetParametersResult(successful=not refused, reason='two limits expected' if refused else '')


class ServedBench:
    """A `Bench` in a context of its own, served by a thread."""

    def __init__(self, domain_id):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
        self.node = Bench(self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._over = False
        self._thread.start()

    def _serve(self):
        while not self._over:
            self._executor.spin_once(timeout_sec=0.05)

    def close(self):
        """End the thread, then the node."""
        self._over = True
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


def ros2(*words, seconds=None):
    """Run a command line and return its exit status; with `seconds` interrupt it after that time."""
    argv = [str(word) for word in words]
    args = make_parser(argv).parse_args(argv)
    if seconds is None:
        return args.main(args)
    timer = threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    try:
        with interruptible():
            return args.main(args)
    except Interrupted as interrupted:
        return interrupted.code
    finally:
        timer.cancel()
