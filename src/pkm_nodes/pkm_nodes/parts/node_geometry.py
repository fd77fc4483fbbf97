"""The kinematics of one node: announced on `geometry`, exchanged on request of the trajectory_generator."""

from pkm_core.errors import PkmError
from pkm_interfaces.msg import Geometry as GeometryMessage
from pkm_interfaces.srv import SetGeometry
from pkm_nodes.runtime.node import LAST_VALUE_QOS
from pkm_nodes.runtime.session import require_session


class NodeGeometry:
    """
    The geometry that `node` uses.

    A node that holds the kinematics of its machine has one of these and reads `machine` where it needs it. The text of
    another machine file comes by the service `<node>/geometry`; no file is opened.

    Parameters
    ----------
    node : PkmNode
    geometry : pkm_core.machines.geometry.Geometry
        As loaded at the start of the node.
    take : callable, optional
        ``take()`` is called after an exchange; `geometry` and `machine` are the new ones then.
    check : callable, optional
        ``check(machine)`` raises a `PkmError` if the node cannot work with this `Machine`.

    Attributes
    ----------
    geometry : pkm_core.machines.geometry.Geometry

    """

    def __init__(self, node, geometry, take=None, check=None):
        self._node, self.geometry = node, geometry
        self._take, self._check = take or (lambda: None), check or (lambda _: None)
        self._publisher = node.create_publisher(GeometryMessage, 'geometry', LAST_VALUE_QOS)
        node.create_service(SetGeometry, f'{node.get_name()}/geometry', self._on_set)
        self._announce()

    @property
    def machine(self):
        """The `Machine` in use."""
        return self.geometry.machine

    def exchange(self, geometry):
        """Use `geometry` from now on."""
        self.geometry = geometry
        self._take()
        self._announce()

    def refuse_another(self, message):
        """Raise `PkmError` if a trajectory message was computed with another geometry; '' fits every one."""
        if message.geometry not in ('', self.geometry.digest):
            raise PkmError(
                f'trajectory of cycle {message.cycle}: geometry {message.geometry!r}; {self._node.get_name()} has '
                f'{self.geometry.digest!r} of {self.geometry.file}'
            )

    def _on_set(self, request, response):
        try:
            require_session(f'{self._node.get_name()}/geometry', request.session, self._node.session)
            geometry = self.geometry.exchanged(request.file, request.text)
            self._check(geometry.machine)
            self.exchange(geometry)
            response.success = True
        except PkmError as refusal:
            response.message = str(refusal)
            self._node.get_logger().error(f'geometry refused: {refusal}')
        response.geometry = self.geometry.digest
        return response

    def _announce(self):
        node, geometry = self._node, self.geometry
        self._publisher.publish(
            GeometryMessage(
                session=node.session,
                node=node.get_name(),
                file=geometry.file,
                geometry=geometry.digest,
                calibrated=geometry.is_calibrated,
            )
        )
