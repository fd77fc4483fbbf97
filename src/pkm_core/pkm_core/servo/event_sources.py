"""Sources of cycle events: which source may publish an event, and on which topic its node publishes too."""

import re

# topic by which the machine is identified
MACHINE = 'machine/cycle'
# events of one source, and a topic of its node
_ONLY = {
    **dict.fromkeys(('STARTED', 'EXTENDED', 'FINISHED', 'FAULT', 'RESET'), ('machine', MACHINE)),
    **dict.fromkeys(('RECORDED', 'NOT_RECORDED'), ('recorder', 'recorder/tick')),
}
# topics whose publishers are looked up regularly: the events of their nodes begin and end cycles
FIRST = (MACHINE, 'recorder/tick', 'pose_trajectory', 'joint_trajectory')
# events by which any client may stop the machine or report something; they start and end nothing else
ANYONE = ('STOP', 'NOTICE')
_JOINT = re.compile(r'[A-Za-z]\w{0,30}', re.ASCII)


def topics_of(event, source):
    """
    Return the topics by which the source of an event is identified, or None if `source` may not publish it.

    The event is genuine if its node publishes on one of the topics: a foreign node that names the source does not. An
    empty tuple stands for an event that every node may publish.

    Parameters
    ----------
    event : str
        Name of the constant of CycleEvent.
    source : str
        As the event names it.

    """
    if event in _ONLY:
        allowed, topic = _ONLY[event]
        return (topic,) if source == allowed else None
    if event in ANYONE:
        return ()
    if event == 'ANNOUNCED':
        return ('pose_trajectory',)
    if event not in ('LOADED', 'REFUSED') or not _JOINT.fullmatch(source):
        return None
    if event == 'LOADED':
        return None if source in ('machine', 'recorder') else (f'{source}/command',)
    # of the machine, of a controller, or of the node that publishes joint_trajectory
    return (MACHINE,) if source == 'machine' else (f'{source}/command', 'joint_trajectory')
