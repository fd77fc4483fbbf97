"""The status of the machine in /diagnostics, told by its sender from a status that another process publishes."""

from time import monotonic

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message

from pkm_core.servo.event_sources import MACHINE
from pkm_nodes.messages.diagnostics import node_of
from pkm_nodes.parts.speakers import MachineProcesses
from pkm_nodes.runtime.discovery import knows_whole_graph
from pkm_nodes.runtime.groups import SenderGroup
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.one_publisher import OnePublisher, participant

# [s, wall] between two looks at the graph because of an unknown sender
_LOOK_EVERY = 0.05


class StatusGate:
    """Decides which status of the machine in the namespace of `node` is believed: of the process of machine/cycle."""

    def __init__(self, node):
        self._name = f'{node.get_namespace().rstrip("/")}/machine'
        self._publisher, self._look_at = OnePublisher(node, MACHINE), 0.0
        self._machines = MachineProcesses(node)
        self._warn = LogThrottle(node.get_logger())

    def status_in(self, data, sender=b''):
        """Return the DiagnosticStatus of the machine in serialized bytes, None without one; `sender` is a GID."""
        try:
            found = [each for each in deserialize_message(data, DiagnosticArray).status if node_of(each) == self._name]
        except (RuntimeError, ValueError, OverflowError) as error:
            self._warn(f'/diagnostics: message of {len(data)} bytes dropped: {error}')
            return None
        if not found or self._is_genuine(sender):
            return found[-1] if found else None
        self._warn(f'/diagnostics: status of {self._name} dropped: not of the process of {self._publisher.topic}')
        return None

    def _is_genuine(self, sender):
        if not sender:
            return True
        now = monotonic()
        if participant(sender) not in self._publisher.participants() and now >= self._look_at:
            self._look_at = now + _LOOK_EVERY
            self._publisher.look()
        known = self._publisher.participants() or self._machines.participants(participant(sender))
        return participant(sender) in known or not (known or knows_whole_graph())


def subscribe_machine_status(node, callback):
    """Call `callback(DiagnosticStatus)` with every status of the machine that passes the `StatusGate` of `node`."""

    def on_message(data, sender=b''):
        status = gate.status_in(data, sender)
        if status is not None:
            callback(status)

    gate = StatusGate(node)
    return node.create_subscription(
        DiagnosticArray, '/diagnostics', on_message, 10, callback_group=SenderGroup(), raw=True
    )
