"""Parameters of every node in the namespace of a cell: requested once per process life, then followed by events."""

import json
from operator import attrgetter
from time import monotonic

from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import qos_profile_parameter_events

from pkm_nodes.parts.one_source import subscribe_own

_EVENTS = '/parameter_events'
# [s, wall] time for a node to answer before `is_complete` ignores it; a later answer still counts
_PATIENCE = 5.0


class GraphParameters:
    """Collects for `node` the parameters of the other nodes in its namespace; call `look_around` periodically."""

    def __init__(self, node):
        self._node = node
        self._asked = {}  # _Question by the id of the node's publisher of _EVENTS, which changes with a restart
        # a discovery server announces the publishers of a topic only to its subscribers
        qos, named = qos_profile_parameter_events, attrgetter('node')
        subscribe_own(node, ParameterEvent, _EVENTS, self._on_change, qos, named)

    def look_around(self):
        """Ask new nodes, and drop those that have left the graph."""
        node = self._node
        there = {
            bytes(info.endpoint_gid): info.node_name
            for info in node.get_publishers_info_by_topic(_EVENTS)
            if info.node_namespace == node.get_namespace() and not info.node_name.startswith('_')
        }
        for life in [life for life in self._asked if life not in there]:
            self._asked.pop(life).release()
        for life, name in there.items():
            if name == node.get_name():
                continue
            if life not in self._asked:
                self._asked[life] = _Question(node, name)
            self._asked[life].proceed()

    def _on_change(self, event):
        for question in self._asked.values():
            if event.node == question.full_name:
                question.change(event)

    def is_complete(self):
        """Return whether every node has answered or its time is over; False before the first `look_around`."""
        return bool(self._asked) and all(question.is_over for question in self._asked.values())

    def values_of(self, parameter):
        """Return the values of `parameter` of all nodes that have answered and have it."""
        answers = [question.values for question in self._asked.values() if question.values is not None]
        return [values[parameter] for values in answers if parameter in values]

    def as_json(self):
        """Return {node: {parameter: value}} as JSON text; null for a node without an answer."""
        own = {name: parameter.value for name, parameter in self._node.get_parameters_by_prefix('').items()}
        found = {question.name: question.values for question in self._asked.values()}
        return json.dumps({self._node.get_name(): own, **found}, sort_keys=True, default=list)


class _Question:
    """Requests the names, then the values of one node's parameters; later changes are added."""

    def __init__(self, node, name):
        self.name, self.full_name = name, f'{node.get_namespace().rstrip("/")}/{name}'
        self.values = None
        self._changes = {}
        self._node = node
        self._list = node.create_client(ListParameters, f'{name}/list_parameters')
        self._get = node.create_client(GetParameters, f'{name}/get_parameters')
        self._asked = None
        self._deadline = monotonic() + _PATIENCE

    @property
    def is_over(self):
        """Whether the node has answered or its time is over."""
        return self.values is not None or monotonic() > self._deadline

    def proceed(self):
        """Send the request as soon as the services are ready; release the clients after the answer."""
        if self.values is not None:
            self.release()
        elif self._asked is None and self._list.service_is_ready() and self._get.service_is_ready():
            self._asked = self._list.call_async(ListParameters.Request())
            self._asked.add_done_callback(self._on_names)

    def _on_names(self, future):
        if self._get is not None:
            names = list(future.result().result.names)
            self._asked = self._get.call_async(GetParameters.Request(names=names))
            self._asked.add_done_callback(lambda answer: self._on_values(names, answer))

    def _on_values(self, names, future):
        values = map(parameter_value_to_python, future.result().values)
        # a change received meanwhile is as new as the answer, or newer
        self.values = dict(zip(names, values, strict=True)) | self._changes

    def change(self, event):
        """Take a ParameterEvent of the node."""
        changed = [*event.new_parameters, *event.changed_parameters]
        self._changes |= {parameter.name: parameter_value_to_python(parameter.value) for parameter in changed}
        if self.values is not None:
            self.values |= self._changes

    def release(self):
        """Destroy the clients."""
        for client in (self._list, self._get):
            if client is not None:
                self._node.destroy_client(client)
        self._list = self._get = None
