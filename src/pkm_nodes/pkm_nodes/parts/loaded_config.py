"""The parameter `config_hash`: which configuration files a controller has loaded."""

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.parameter import Parameter

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
    loaded : str
        `loop_hash` of what the node has loaded.

    """

    def __init__(self, node, loaded):
        self._node, self._loaded = node, loaded
        descriptor = ParameterDescriptor(description=_DESCRIPTION)
        node.declare_parameter(CONFIG_HASH, loaded, descriptor, ignore_override=True)
        node.add_on_set_parameters_callback(self._on_set)

    def replace(self, loaded):
        """Announce that the node has loaded other files, with this `loop_hash`."""
        self._loaded = loaded
        self._node.set_parameters([Parameter(CONFIG_HASH, value=loaded)])

    def _on_set(self, parameters):
        for parameter in parameters:
            if parameter.name == CONFIG_HASH and parameter.value != self._loaded:
                reason = f'{CONFIG_HASH}: {parameter.value!r} given; only the node itself sets it, with its reload'
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)
