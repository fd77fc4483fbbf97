"""The parameters of every node in the namespace of a cell: asked for once in the life of each, then followed."""

import json
from time import monotonic

from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import qos_profile_parameter_events

_EVENTS = '/parameter_events'
# [s, wall] how long a node may take to answer before nobody waits for it; what it says later still counts
_PATIENCE = 5.0


class GraphParameters:
    """Collects for `node` the parameters of its neighbours; call `look_around` now and then."""

    def __init__(self, node):
        self._node = node
        self._asked = {}  # _Question by the id of the node's publisher of _EVENTS, which no other life of it has
        # a discovery server names the publishers of a topic only to those who listen to it
        node.create_subscription(ParameterEvent, _EVENTS, self._on_change, qos_profile_parameter_events)

    def look_around(self):
        """Ask the nodes that have come up, and forget those that have gone."""
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
            self._asked[life].go_on()

    def _on_change(self, event):
        for question in self._asked.values():
            if event.node == question.full_name:
                question.change(event)

    def is_complete(self):
        """Tell whether every node there is has answered, or has had its time; False before the first look."""
        return bool(self._asked) and all(question.is_over for question in self._asked.values())

    def as_json(self):
        """Return {node: {parameter: value}} as JSON text; null for a node that has not answered."""
        own = {name: parameter.value for name, parameter in self._node.get_parameters_by_prefix('').items()}
        found = {question.name: question.values for question in self._asked.values()}
        return json.dumps({self._node.get_name(): own, **found}, sort_keys=True, default=list)


class _Question:
    """One node is asked for the names, then for the values of its parameters; what it changes afterwards is noted."""

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
        """Whether the node has answered, or has had its time."""
        return self.values is not None or monotonic() > self._deadline

    def go_on(self):
        """Ask as soon as the node can hear; give back what that took once it has answered."""
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
        # what has changed meanwhile is as new as the answer, or newer
        self.values = dict(zip(names, values, strict=True)) | self._changes

    def change(self, event):
        """Note what the node says it has changed."""
        changed = [*event.new_parameters, *event.changed_parameters]
        self._changes |= {parameter.name: parameter_value_to_python(parameter.value) for parameter in changed}
        if self.values is not None:
            self.values |= self._changes

    def release(self):
        """Give back what it took to ask."""
        for client in (self._list, self._get):
            if client is not None:
                self._node.destroy_client(client)
        self._list = self._get = None
