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
from rclpy.action import ActionServer
from rclpy.exceptions import InvalidHandle, ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from pkm_core.config import Configuration
from pkm_core.errors import ConfigError, PkmError
from pkm_core.interrupts import SIGNALS, blocked
from pkm_nodes.runtime.fast_path import FAST_PATH
from pkm_nodes.runtime.groups import HotGroup
from pkm_nodes.runtime.parameter_sources import place_of, sources_of
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
# States: as a trajectory for subscribers that keep up; a late one that asks for it has the last value at once.
STATE_QOS = reliable(100)
STATE_QOS.durability = DurabilityPolicy.TRANSIENT_LOCAL
# Subscriptions to events: a burst of messages does not push those of the cell out of the queue.
EVENT_QOS = reliable(10_000)
# Requests of goals: rclpy's ten are too few for many clients at once, and the rest would get no answer.
REQUEST_QOS = reliable(1000)
# A state: a late subscriber gets the last value. Also diagnostics.
LAST_VALUE_QOS = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)

# descriptions of parameters that several nodes and the launch file have
MACHINE = 'machine of config/machines, or a YAML file'
CONTROL = "choice of the controllers: 'robust', 'observer', 'computed_torque', a file of config/control, or a YAML file"

CALIBRATED = 'folder of calibrated machine files; geometry/load takes files from it only'
PLUGINS = 'comma-separated folders whose Python files may be learning laws; none by default, never named by message'


class PkmNode(Node):
    """
    A node in /pkm (remap __ns to move it) that refuses unknown parameters.

    Parameters
    ----------
    name : str
    known_elsewhere : collection of str, optional
        Parameters that another node of the process declares: `-p name:=value` of a command line reaches every node of
        the process. None: the maker of all nodes calls `check_given` with them.

    Attributes
    ----------
    session : str
        Value of the parameter `session`.
    given : dict of str
        Parameters that the command line of the process gives to this node.
    hardware_id : str
        In diagnostics: the name of the machine, '' without one; a node that knows more adds it.

    """

    def __init__(self, name, *, known_elsewhere=(), **kwargs):
        super().__init__(name, **{'namespace': 'pkm', **kwargs})
        self._known_elsewhere = None if known_elsewhere is None else frozenset(known_elsewhere)
        with self.handle:
            self.given = {name: parameter.value for name, parameter in self.handle.get_parameters(Parameter).items()}
        self.hot_group, self.hardware_id = HotGroup(), ''
        self.tick_subscriptions = []
        self.session = checked_session(self.setting('session', '', SESSION))

    def setting(self, name, default, description):
        """
        Declare the read-only parameter `name` and return its value; the type of `default` is binding.

        A float is a duration or another size: `ConfigError` unless it is `default`, or positive and finite.
        """
        value = self._declare(name, default, description, read_only=True)
        if isinstance(value, float) and value != default and not 0 < value < inf:
            raise ConfigError(
                f'{self.get_fully_qualified_name()}: {name} is {value}; expected a positive, finite number '
                f'({description})'
            )
        return value

    def machine_setting(self):
        """Declare the parameter `machine` and return its value, a name or a file."""
        name = self.setting('machine', 'four_dof', MACHINE)
        self.hardware_id = Path(name).stem
        return name

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
        try:
            return self.declare_parameter(name, default, descriptor).value
        except ParameterException:
            came, node = self._parameter_overrides[name], self.get_fully_qualified_name()
            kind = Parameter(name, value=default).type_.name.lower()
            raise ConfigError(
                f'{node}: {name} is {came.value!r} ({came.type_.name.lower()}){place_of(name, node)}; expected {kind}'
            ) from None

    def check_settings(self):
        """Refuse parameters that were given and not declared: `ConfigError`. rclpy ignores a misspelt name."""
        if self._known_elsewhere is not None:
            self.check_given(self._known_elsewhere)

    def check_given(self, known_elsewhere):
        """
        Refuse parameters that were given and are declared neither here nor in `known_elsewhere`: `ConfigError`.

        As in ROS, a section of a file that is for any node may have parameters of others; one log line names them.
        """
        known, node = self.declared(), self.get_fully_qualified_name()
        given = set(self._parameter_overrides)  # rclpy has no public way to ask what was given
        unknown = given - known - frozenset(known_elsewhere)
        unknown = sorted(name for name in unknown if not name.startswith('qos_overrides.'))
        of_others = {}
        for name in unknown:
            sources = sources_of(name, node)
            if sources and all(source.for_all for source in sources):
                of_others[name] = sources[-1].text
        unknown = [name for name in unknown if name not in of_others]
        if unknown:
            places = ''.join(place_of(name, node) for name in unknown[:1])
            raise ConfigError(f'{node} has unknown parameter(s) {unknown}{places}; known: {sorted(known)}')
        for name, place in of_others.items():
            self.get_logger().warning(f'{name} ({place}) is a parameter of no node here and is not used')

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

    def on_tick_topic(self, message_type, topic, callback, *, size):
        """Return a `TickSubscription` to `topic`: `callback(data)` takes serialized messages of `size` [bytes]."""
        subscription = TickSubscription(self, message_type, topic, callback, TICK_QOS, size=size)
        self.tick_subscriptions.append(subscription)
        return subscription

    def refused_messages(self):
        """Return how many messages of the servo tick this node has dropped, because of their size or byte order."""
        return sum(subscription.refused for subscription in self.tick_subscriptions)

    def foreign_messages(self):
        """Return how many messages of the servo tick this node has dropped, because of their sender."""
        return sum(subscription.foreign for subscription in self.tick_subscriptions)

    def serve_action(self, action_type, name, execute, on_cancel):
        """Return an ActionServer whose queues hold the goals of many clients at once; see rclpy for the callbacks."""
        queues = {f'{kind}_service_qos_profile': REQUEST_QOS for kind in ('goal', 'result')}
        return ActionServer(self, action_type, name, execute, cancel_callback=on_cancel, **queues)

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
    except MemoryError:
        print(
            'out of memory; raise the limit of the address space (ulimit -v), or end other processes', file=sys.stderr
        )
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
