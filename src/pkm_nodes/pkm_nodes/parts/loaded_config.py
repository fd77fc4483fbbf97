"""The parameter `config_hash`: which configuration files a controller has loaded."""

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.parameter import Parameter

from pkm_core.recording.provenance import loop_hash, machine_hash

CONFIG_HASH = 'config_hash'
_DESCRIPTION = 'hash of the files of machine, model and gains that are in use; set by the node itself'


class LoadedConfig:
    """
    Declares `config_hash` as a parameter of `node` that only the node changes.

    A parameter, because its changes are announced on /parameter_events: the recorder writes the value that holds when a
    cycle begins into the bag of that cycle.

    Parameters
    ----------
    node : PkmNode
        Has the parameter `machine`.
    machine : Machine
        As loaded at the start of the node.
    control : str
        Choice of the gains.

    """

    def __init__(self, node, machine, control):
        self._node, self._machine, self._control = node, machine, control
        self._machine_hash = machine_hash(node.get_parameter('machine').value, machine.configuration)
        self._loaded = self.now()
        descriptor = ParameterDescriptor(description=_DESCRIPTION)
        node.declare_parameter(CONFIG_HASH, self._loaded, descriptor, ignore_override=True)
        node.add_on_set_parameters_callback(self._on_set)

    def now(self):
        """Return the `loop_hash` of the files as they are now."""
        return loop_hash(self._machine, self._control, self._machine_hash)

    def replace(self, loaded):
        """Announce that the node has loaded the files with this `loop_hash`."""
        self._loaded = loaded
        self._node.set_parameters([Parameter(CONFIG_HASH, value=loaded)])

    def _on_set(self, parameters):
        for parameter in parameters:
            if parameter.name == CONFIG_HASH and parameter.value != self._loaded:
                reason = f'{CONFIG_HASH}: {parameter.value!r} given; only the node itself sets it, with its reload'
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)
