"""The pieces of a jog in a controller: checked when they arrive, in force from their first tick on."""

from collections import deque
from dataclasses import replace

import numpy as np

from pkm_core.errors import PkmError
from pkm_core.motion.pieces import checked_piece
from pkm_interfaces.msg import CycleEvent
from pkm_nodes.messages.conversions import trajectory_from_msg


class CyclePieces:
    """
    The pieces that extend the running cycle, up to the machine's decision to use them.

    Parameters
    ----------
    machine : Machine
    events : dict of str to CycleEvents
        By joint of the controller.
    law : CycleLaw
    log_refusal : callable
        Takes the text of a refusal.

    """

    def __init__(self, machine, events, law, log_refusal):
        self._machine, self._events, self._law, self._log_refusal = machine, events, law, log_refusal
        # (LoadedCycle, function that puts it in force), oldest first; two if a piece overtakes the tick before it
        self._next = deque()

    def clear(self):
        """Forget all pieces: the cycle has ended."""
        self._next.clear()

    def put_in_force(self, index):
        """Use the piece that begins with sample `index`; return its `LoadedCycle`, None if it is in use already."""
        if not self._next or self._next[0][0].message.offset != index:  # a further joint of the same tick
            return None
        extended, put = self._next.popleft()
        put()
        return extended

    def take(self, message, loaded):
        """
        Take a joint_trajectory that is a piece of the cycle `loaded`, and report it as LOADED.

        One that does not begin at the `hold` is ignored. A refused one ends the jog: the machine drives the stop of the
        piece before.
        """
        before = self._next[-1][0] if self._next else loaded
        if message.offset != before.message.hold:
            return
        machine, offset = self._machine, message.offset
        try:
            piece = trajectory_from_msg(message, coordinates=machine.joints, sample_time=machine.sample_time)
            whole = checked_piece(machine, before.trajectory, offset, piece)
            errors = np.zeros((len(whole), len(self._events)))
            extended = replace(before, message=message, trajectory=whole, errors=errors)
            put_in_force = self._law.extend(extended, offset)
        except PkmError as error:
            self._log_refusal(f'piece of a jog refused: {error}')
            for events in self._events.values():
                events.publish(CycleEvent.NOTICE, message.cycle, message=f'jog: {error}')
            return

        def put():
            errors[:offset] = before.errors[:offset]
            put_in_force()

        self._next.append((extended, put))
        for events in self._events.values():
            events.publish(CycleEvent.LOADED, message.cycle, samples=len(whole), hold=message.hold)
