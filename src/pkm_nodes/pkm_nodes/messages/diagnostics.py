"""
Diagnostics of the nodes: values by documented key, and one line for people.

A program reads the keys, never the message. docs/interfaces.md lists keys and values. A status is named as those of
diagnostic_updater, by its node and its subject: '/pkm/machine: state'. An analyzer of diagnostic_aggregator selects the
statuses of a cell by the begin of their names, '/pkm/'.
"""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

STATE = 'state'  # machine, controllers, recorder, state_estimator: one word
CYCLE = 'cycle'  # machine, controllers: number of the last started or loaded cycle
TICK = 'tick'  # machine: next tick; recorder: last tick of all topics
FAULT = 'fault'  # machine: reason of the safe stop, '' without one
NOTICE = 'notice'  # controllers: last observation of the learning monitor, '' without one
REFUSED = 'refused messages'  # machine, controllers: malformed messages of the tick that were dropped
FOREIGN = 'foreign messages'  # machine, controllers, recorder: messages of other publishers that were dropped
OTHERS = 'other publishers'  # machine, controllers: topics with further publishers, and their nodes; '' without one
PACE_ASKED = 'pace'  # machine: simulated time per wall time as set, 0.0: as fast as possible
PACE_REACHED = 'pace reached'  # machine: the same as measured in the running or last cycle, '' before the first
PAUSED = 'paused'  # machine: 'true' or 'false'
# machine: how late its ticks began, over the last ones since the pace was set; '' without a pace
LATENESS = ('late by, mean [us]', 'late by, 99 % [us]', 'late by, largest [us]', 'late by a tick [%]')
COVARIANCE = 'covariance'  # state_estimator: origin of the covariance of the pose
GEOMETRY = 'geometry'  # state_estimator: hash of the kinematics in use
GOAL = 'goal'  # trajectory_generator: the running goal or command and its cycle, '' without one
REFUSED_COMMANDS = 'refused commands'  # trajectory_generator: commands by topic that were not run to their end
REFUSAL = 'refusal'  # trajectory_generator: why the last command by topic was not, '' if it was
FAILURE = 'failure'  # recorder: why the last cycle was not recorded, '' if it was
LATE = 'late answers'  # machine: ticks of which an answer was late, see `TickBarrier.look`
LONGEST = 'longest wait [s]'  # machine: for the answers to one of these ticks
TICK_RATE = 'tick rate [1/s]'  # machine: ticks per second of wall time since the last status
STATE_RATE = 'state rate [1/s]'  # state_estimator: states of ticks per second of wall time since the last status
_SUBJECT = ': state'  # what a status is about; a node has one


def diagnostics(node, level, message, values, stamp):
    """
    Return the DiagnosticArray of one node.

    Parameters
    ----------
    node : PkmNode
        Named in the status, with its `hardware_id`.
    level : bytes
        OK, WARN or ERROR of DiagnosticStatus.
    message : str
        For people.
    values : dict
        By key; written with `str`.
    stamp : builtin_interfaces.msg.Time
        Simulated time.

    """
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    name = node.get_fully_qualified_name() + _SUBJECT
    status = DiagnosticStatus(level=level, name=name, message=message, hardware_id=node.hardware_id, values=pairs)
    array = DiagnosticArray(status=[status])
    array.header.stamp = stamp
    return array


def node_of(status):
    """Return the full name of the node that a DiagnosticStatus is of; a name without a subject is that of a node."""
    return status.name.partition(': ')[0]


def values_of(status):
    """Return {key: value} of a DiagnosticStatus, all str."""
    return {pair.key: pair.value for pair in status.values}
