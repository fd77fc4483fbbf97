"""
The geometry of a cell: all its nodes use the same one, or no cycle begins.

The trajectory_generator decides, because it begins the cycles. Its own geometry is that of the cell. It is exchanged
when every other node has taken up the new one. A node that has another geometry before a cycle, because it was started
again, gets that of the cell first.
"""

from pathlib import Path

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from pkm_core.errors import ConfigError, PkmError
from pkm_core.yaml_text import YamlError, read_text
from pkm_interfaces.msg import Geometry as GeometryMessage
from pkm_interfaces.srv import LoadGeometry, SetGeometry
from pkm_nodes.parts.one_source import subscribe_own
from pkm_nodes.parts.waiting import Waiting
from pkm_nodes.runtime.session import belongs, require_session

# [s, wall] for the answer of one node
_ANSWER = 5.0
# [s, wall] from the discovery of a node to its first message
_ANNOUNCED = 1.0
# the last value of every node of a cell, not of one
_ALL_NODES_QOS = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


class CellGeometry:
    """
    Offers the service `geometry/load` for `node`, the trajectory_generator.

    Parameters
    ----------
    node : PkmNode
    own : NodeGeometry
        Of the node; that of the cell.
    folder : str
        Folder whose machine files may be loaded.
    occupy : callable
        ``occupy(what)`` keeps goals out until ``occupy('')``; `PkmError` while a goal or a cycle runs.
    on_exchange : callable
        ``on_exchange(text)`` is called after every exchange.

    """

    def __init__(self, node, own, folder, occupy, on_exchange):
        self._node, self._own, self._of_start = node, own, own.geometry
        self._folder = Path(folder).resolve()
        self._occupy, self._on_exchange = occupy, on_exchange
        self._used = {}  # hash by node
        self._waiting = Waiting(node)
        self._clients = {}  # by node
        subscribe_own(node, GeometryMessage, 'geometry', self._on_geometry, _ALL_NODES_QOS, self._full_name)
        alone = MutuallyExclusiveCallbackGroup()  # in the common group it would block the answers it waits for
        node.create_service(LoadGeometry, 'geometry/load', self._on_load, callback_group=alone)

    async def align(self):
        """Give the geometry of the cell to every node that has another one; `PkmError` if that fails."""
        digest = self._own.geometry.digest
        others = self._others()
        await self._waiting.until(lambda: self._used.keys() >= set(others), _ANNOUNCED)
        for name in others:
            if self._used.get(name) != digest:
                self._used[name] = await self._set(name, self._own.geometry)
                self._on_exchange(f'{name}: was given the geometry of the cell, hash {digest}')

    def _full_name(self, message):
        return f'{self._node.get_namespace().rstrip("/")}/{message.node}'

    def _on_geometry(self, message):
        if belongs(message.session, self._node.session):
            self._used[message.node] = message.geometry

    def _others(self):
        """Return the names of the other nodes with a geometry, in the order of their names."""
        publishers = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name('geometry'))
        names = {each.node_name for each in publishers if not each.node_name.startswith('_')}  # '_': not yet known
        return sorted(names - {self._node.get_name()})

    async def _on_load(self, request, response):
        node = self._node
        try:
            require_session('geometry/load', request.session, node.session)
            geometry = self._of_start
            if request.file:
                geometry = self._own.geometry.exchanged(*self._read(request.file))
            self._occupy(f'the exchange of the geometry for {geometry.file}')
            try:
                await self._exchange(geometry)
            finally:
                self._occupy('')
            response.success = True
            response.message = f'geometry of {geometry.file}, hash {geometry.digest}, is in use'
        except PkmError as refusal:
            response.message = str(refusal)
            node.get_logger().error(f'geometry/load refused: {refusal}')
        response.geometry = self._own.geometry.digest
        return response

    def _read(self, file):
        """Return path and content of the machine file `file`; `ConfigError` unless it is in the folder of the node."""
        path = (self._folder / file).resolve()
        name = self._own.machine.name
        if not path.is_relative_to(self._folder):
            raise ConfigError(
                f'{file}: is not in {self._folder}; allowed: files in the folder of the parameter calibrated'
            )
        if path.stem != name:
            raise ConfigError(f'{file}: is a file of machine {path.stem!r}; this cell has {name!r}')
        try:
            return path, read_text(path)
        except (OSError, UnicodeDecodeError, YamlError) as error:
            raise ConfigError(f'{file}: cannot be read: {getattr(error, "strerror", None) or error}') from None

    async def _exchange(self, geometry):
        """Make all nodes use `geometry`; if one refuses, those before it get the present one again: `PkmError`."""
        before, done = self._own.geometry, []
        try:
            for name in self._others():
                done.append(name)  # one that does not answer may have taken it
                self._used[name] = await self._set(name, geometry)
        except PkmError as refusal:
            for name in done:
                try:
                    self._used[name] = await self._set(name, before)
                except PkmError as error:
                    self._node.get_logger().error(f'{name}: keeps another geometry: {error}')
            raise PkmError(f'{refusal}; geometry {before.digest} of {before.file} stays in use') from None
        self._own.exchange(geometry)
        self._on_exchange(
            f'geometry of {geometry.file}, hash {geometry.digest}, is in use from this cycle on; '
            f'before: {before.file}, hash {before.digest}'
        )

    async def _set(self, name, geometry):
        """Make the node `name` use `geometry` and return the hash; `PkmError` if it refuses or does not answer."""
        if name not in self._clients:
            self._clients[name] = self._node.create_client(SetGeometry, f'{name}/geometry')
        client, digest = self._clients[name], geometry.digest
        if not await self._waiting.until(client.service_is_ready, _ANSWER):
            raise PkmError(f'{name}: does not offer {client.srv_name}; start it again, or stop it')
        request = SetGeometry.Request(session=self._node.session, file=geometry.file, text=geometry.text)
        answer = client.call_async(request)
        if not await self._waiting.until(answer.done, _ANSWER):
            client.remove_pending_request(answer)
            raise PkmError(f'{name}: no answer from {client.srv_name} within {_ANSWER:g} s')
        response = answer.result()
        if not response.success or response.geometry != digest:
            other = f'has geometry {response.geometry} after {geometry.file}, hash {digest}'
            raise PkmError(f'{name}: {response.message or other}')
        return response.geometry
