"""Base class of the nodes of the cell: namespace, checked parameters, quality of service, and the main loop."""

import gc
import signal
import sys
from contextlib import suppress
from dataclasses import replace
from math import inf
from pathlib import Path

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import InvalidHandle, ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from pkm_core.config import Configuration
from pkm_core.errors import ConfigError, PkmError
from pkm_core.interrupts import SIGNALS, blocked
from pkm_nodes.runtime.fast_path import FAST_PATH
from pkm_nodes.runtime.groups import HotGroup
from pkm_nodes.runtime.session import SESSION, checked_session
from pkm_nodes.runtime.tick_subscription import TickSubscription

RCLError = rclpy_implementation.RCLError
# errors of a node that is not started as it should be: they end its process with one line
REFUSALS = (
    PkmError,
    ParameterException,
    rclpy_implementation.RCLInvalidROSArgsError,
    rclpy_implementation.UnknownROSArgsError,
)


def reliable(depth):
    """Return the quality of service of the cell's topics: reliable, without old messages for a late reader."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


# Servo tick: deep enough for a recorder that lags by the machine's largest recorder_window.
TICK_QOS = reliable(1000)
# Trajectories and events of a cycle.
CYCLE_QOS = reliable(100)
# A state: a late subscriber gets the last value.
LAST_VALUE_QOS = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)

# descriptions of parameters that several nodes and the launch file have
MACHINE = 'machine of config/machines, or a YAML file'
CONTROL = "choice of the controllers: 'robust', 'computed_torque', a file of config/control, or a YAML file"


PLUGINS = 'comma-separated folders whose Python files may be learning laws; none by default, never named by message'


class PkmNode(Node):
    """
    A node in /pkm (remap __ns to move it) that refuses unknown parameters.

    Parameters
    ----------
    name : str
    known_elsewhere : collection of str
        Parameters that another node of the process declares: `-p name:=value` of a command line reaches every node of
        the process.

    Attributes
    ----------
    session : str
        Value of the parameter `session`.

    """

    def __init__(self, name, *, known_elsewhere=(), **kwargs):
        super().__init__(name, **{'namespace': 'pkm', **kwargs})
        self._known_elsewhere = frozenset(known_elsewhere)
        self.hot_group = HotGroup()
        self.tick_subscriptions = []
        self.session = checked_session(self.setting('session', '', SESSION))

    def setting(self, name, default, description):
        """
        Declare the read-only parameter `name` and return its value; the type of `default` is binding.

        A float is a duration or another size: `ConfigError` unless it is positive and finite.
        """
        value = self._declare(name, default, description, read_only=True)
        if isinstance(value, float) and not 0 < value < inf:
            raise ConfigError(
                f'{self.get_fully_qualified_name()}: {name} is {value}; expected a positive, finite number '
                f'({description})'
            )
        return value

    def machine_setting(self):
        """Declare the parameter `machine` and return its value, a name or a file."""
        return self.setting('machine', 'four_dof', MACHINE)

    def configuration_setting(self):
        """Declare the parameter `plugins`; return the configuration, which takes code from these folders only."""
        named = self.setting('plugins', '', PLUGINS)
        folders = tuple(Path(folder.strip()).resolve() for folder in named.split(',') if folder.strip())
        return replace(Configuration.of_environment(), plugins=folders)

    def control_setting(self):
        """Declare the parameter `control` and return its value, as `find_control` takes it."""
        return self.setting('control', 'robust', CONTROL)

    def tunable(self, name, default, description):
        """Declare the parameter `name`, which may be set while the node runs, and return its value."""
        return self._declare(name, default, description, read_only=False)

    def _declare(self, name, default, description, *, read_only):
        descriptor = ParameterDescriptor(description=description, read_only=read_only)
        return self.declare_parameter(name, default, descriptor).value

    def check_settings(self):
        """Refuse parameters that were given and not declared: `ConfigError`. rclpy ignores a misspelt name."""
        known = self.declared()
        given = set(self._parameter_overrides)  # rclpy has no public way to ask what was given
        unknown = given - known - self._known_elsewhere
        unknown = sorted(name for name in unknown if not name.startswith('qos_overrides.'))
        if unknown:
            raise ConfigError(
                f'{self.get_fully_qualified_name()} has unknown parameter(s) {unknown}; known: {sorted(known)}'
            )

    def declared(self):
        """Return the names of all parameters that the node has declared so far."""
        return frozenset(self.get_parameters_by_prefix(''))

    def offer(self, name, do):
        """
        Offer `do()` as the std_srvs/Trigger service `name`.

        The text it returns, if any, is the message of the response; a `PkmError` is a refusal with its text.
        """

        def answer(_, response):
            try:
                response.message, response.success = do() or '', True
            except PkmError as refusal:
                response.message = str(refusal)
            return response

        self.create_service(Trigger, name, answer)

    def on_tick_topic(self, message_type, topic, callback, *, size=None):
        """
        Return a `TickSubscription` to `topic`, served before everything else.

        With the `size` [bytes] of a serialized message, `callback` takes serialized messages.
        """
        subscription = TickSubscription(self, message_type, topic, callback, TICK_QOS, size=size)
        self.tick_subscriptions.append(subscription)
        return subscription

    def refused_messages(self):
        """Return how many messages of the servo tick this node has dropped, because of their size or byte order."""
        return sum(subscription.refused for subscription in self.tick_subscriptions)

    def tick_publisher(self, message_type, topic):
        """Return a publisher on a topic of the servo tick, and the function that publishes serialized messages."""
        publisher = self.create_publisher(message_type, topic, TICK_QOS)
        return publisher, FAST_PATH.sender(publisher, self.context)


def spin(nodes):
    """Serve `nodes` in one executor until the context is shut down."""
    executor = FAST_PATH.executor(rclpy.get_default_context())
    for node in nodes:
        executor.add_node(node)
    # exempt all present objects from garbage collection: a full one takes 0.1 s
    gc.collect()
    gc.freeze()
    executor.spin()


def run(make_nodes, args=None):
    """
    Run the nodes `make_nodes()` returns until interrupted; return the exit code of the process.

    A refused configuration or parameter ends the process with one line and code 1.
    """
    nodes = []
    try:
        begin(args)
        nodes += make_nodes()
        spin(nodes)
    except REFUSALS as error:
        print(error, file=sys.stderr)
        return 1
    except Exception:
        if rclpy.ok():
            raise
        # interrupted: the context is gone, and whatever used it has raised something
    finally:
        for node in nodes:
            with suppress(RCLError, InvalidHandle):  # as above; every node is destroyed, the recorder closes its bag
                node.destroy_node()
        with suppress(RCLError):  # the thread of the signal handler may have done so
            rclpy.try_shutdown()
    return 0


def begin(args=None):
    """
    Initialise rclpy in a process that SIGINT and SIGTERM end between two callbacks, with exit code 0.

    rclpy's handler shuts the context down and then calls the one before it. That one does nothing: an exception would
    end a callback, and break the bag of the recorder. No signal is lost in between, because both are blocked.
    """
    with blocked():
        for number in SIGNALS:
            signal.signal(number, lambda *_: None)
        rclpy.init(args=args)


def entry_point(make):
    """
    Return the function `main` of an executable.

    Parameters
    ----------
    make : callable
        The class of the node, or a function that returns all nodes of the process. The nodes in the attribute `parts`
        of a single node run in the same process.

    Returns
    -------
    main : callable
        ``main(args=None)`` runs the nodes, see `run`, and ends the process with the exit code.

    """

    def make_nodes():
        made = make()
        return made if isinstance(made, list) else [made, *getattr(made, 'parts', ())]

    def main(args=None):
        sys.exit(run(make_nodes, args))

    return main
