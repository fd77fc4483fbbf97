"""Topics of a cell with more publishers than allowed, and the service learning/update with more than one server."""

from time import monotonic

from pkm_nodes.runtime.one_publisher import OnePublisher

# [s, wall] other nodes remove a publisher from their graph at slightly different times
SETTLE = 1.0
LEARNING = 'learning/update'
# [s, wall] between two looks at the publishers of results
_LOOK_EVERY = 0.5


class Intruders:
    """
    What `node`, the machine, finds in the graph beside the nodes of its cell.

    Parameters
    ----------
    node : PkmNode
    taken : sequence of TickSubscription
        Their messages are taken from one publisher, which `find` binds.
    events : EventGate
        Of the node.
    topics : sequence of str
        Further topics of one publisher.
    results : sequence of str
        Topics of one publisher of which the machine needs nothing; looked up less often.

    Attributes
    ----------
    present : str
        Publishers beside the first ones at the last `look`, in words; '' without one.

    """

    def __init__(self, node, taken, events, topics, results):
        self._node, self._taken, self._events = node, taken, events
        self._others = [OnePublisher(node, topic) for topic in topics]
        self._results = [OnePublisher(node, topic) for topic in results]
        self._crowded_results, self._look_at = [], 0.0
        self._others.append(OnePublisher(node, 'joint_trajectory', besides='pose_trajectory'))
        self.present = ''
        self._settled_at = 0.0
        self._reported = (0, '')  # cycle and text of the last `news`
        self._foreign_before = 0

    @property
    def foreign(self):
        """Number of messages that were dropped because of their sender."""
        return sum(each.foreign for each in (*self._taken, self._events))

    def find(self):
        """Bind the publishers that are alone; return what has several, with their nodes, '' if nothing has."""
        found = [each.publisher.describe() for each in self._taken if not each.bind()]
        found += [each.describe() for each in self._others if not each.look()]
        found += filter(None, [several_servers(self._node, LEARNING)])
        now = monotonic()
        if now >= self._look_at:
            self._look_at = now + _LOOK_EVERY
            self._crowded_results = [each.describe() for each in self._results if not each.look()]
        found += self._crowded_results
        if found:
            self._settled_at = now + SETTLE
        self._foreign_before = self.foreign
        self.present = '; '.join(found)
        if found or now < self._settled_at:
            return f'{self.present or "topics had several publishers"}; allowed: one each. Stop the others'
        return ''

    def look(self):
        """Read the graph during a cycle: `present` names the publishers whose messages are dropped."""
        publishers = [*(each.publisher for each in self._taken), *self._others, *self._results]
        for each in publishers:
            each.look()
        crowded = [each for each in publishers if each.others]
        found = [f'{each.topic}: {", ".join(each.others)}' for each in crowded]
        if nodes := self._events.foreign_nodes():
            found += [f'cycle events: {", ".join(nodes)}']
        self.present = f'messages of further publishers are dropped: {"; ".join(found)}' if found else ''

    def news(self, cycle):
        """Return `present` if `cycle` has not been told it, after a look if foreign messages have arrived."""
        if self.foreign != self._foreign_before:
            self._foreign_before = self.foreign
            self.look()
        if not self.present or self._reported == (cycle, self.present):
            return ''
        self._reported = cycle, self.present
        return self.present


def results_of(joints):
    """Return the topics of a cell with `joints` that are read, or recorded, from one publisher each after the tick."""
    per_joint = [f'{joint}/{name}' for joint in joints for name in ('cycle_metrics', 'cycle_error')]
    return [*per_joint, 'laser', 'joint_correction', 'excitation', 'pose', 'twist', 'joint_states', 'markers']


def several_servers(node, service):
    """Return the servers of `service` in words if there are several, else ''."""
    name = node.resolve_service_name(service)
    if node.count_services(name) < 2:
        return ''
    servers = []
    for node_name, namespace in node.get_node_names_and_namespaces():
        try:
            offered = node.get_service_names_and_types_by_node(node_name, namespace)
        except RuntimeError:  # it has left meanwhile
            continue
        servers += [f'{namespace.rstrip("/")}/{node_name}'] if name in dict(offered) else []
    return f'service {name} has {max(2, len(servers))} servers, {", ".join(sorted(servers))}'
