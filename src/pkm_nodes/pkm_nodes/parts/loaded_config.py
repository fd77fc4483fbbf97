"""The parameters `config_hash`, `truth_hash`: which files a controller, and the simulated machine, have loaded."""

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.parameter import Parameter

from pkm_core.machines.geometry import load_geometry
from pkm_core.recording.provenance import control_hash, joined_hash, truth_hash
from pkm_nodes.parts.node_geometry import NodeGeometry

CONFIG_HASH, TRUTH_HASH = 'config_hash', 'truth_hash'
_DESCRIPTION = 'hash of the files of machine, model and gains that are in use; set by the node itself'


def declare_truth_hash(node, machine):
    """Declare the read-only parameter `truth_hash` of `node`, the simulated `machine`, which has loaded the file."""
    description = 'hash of the file of config/truth that is in use; set by the node itself'
    descriptor = ParameterDescriptor(description=description, read_only=True)
    node.declare_parameter(TRUTH_HASH, truth_hash(machine), descriptor, ignore_override=True)


class LoadedConfig:
    """
    Declares `config_hash` as a parameter of `node` that only the node changes.

    A parameter, because its changes are announced on /parameter_events: the recorder writes the value that holds when a
    cycle begins into the bag of that cycle. The controllers work in joints: another geometry changes their hash only.

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
        geometry = load_geometry(node.get_parameter('machine').value, machine.configuration)
        self._geometry = NodeGeometry(node, geometry, self._announce)
        self._files = self.now()
        descriptor = ParameterDescriptor(description=_DESCRIPTION)
        node.declare_parameter(CONFIG_HASH, self._loop_hash(), descriptor, ignore_override=True)
        node.add_on_set_parameters_callback(self._on_set)

    def now(self):
        """Return the `control_hash` of the files as they are now."""
        return control_hash(self._machine, self._control)

    def replace(self, loaded):
        """Announce that the node has loaded the files with this `control_hash`."""
        self._files = loaded
        self._announce()

    def _loop_hash(self):
        return joined_hash(self._geometry.geometry.file_hash, self._files)

    def _announce(self):
        self._node.set_parameters([Parameter(CONFIG_HASH, value=self._loop_hash())])

    def _on_set(self, parameters):
        for parameter in parameters:
            if parameter.name == CONFIG_HASH and parameter.value != self._loop_hash():
                reason = f'{CONFIG_HASH}: {parameter.value!r} given; only the node itself sets it, with its reload'
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)
