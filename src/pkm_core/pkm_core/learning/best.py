"""The best feedforward of each joint while a motion is learned."""

from dataclasses import dataclass, replace

import numpy as np

from pkm_core.control.robust import RobustGains
from pkm_core.errors import LearningError
from pkm_core.learning import make_law
from pkm_core.learning.basis import BasisLaw
from pkm_core.learning.store import Learned, origin_of


@dataclass(frozen=True)
class _Row:
    error: float  # [m] rms
    gains: RobustGains
    feedforward: np.ndarray  # (N,) [V]


class Best:
    """
    The feedforward of each joint with the lowest rms error, for one motion under one law.

    Parameters
    ----------
    machine : Machine
    motion : str
        Name of the motion.
    law : str
        Name of the law.
    trajectory : SampledTrajectory
        The motion, in joints.
    planned : str
        `store.digest_of` the planned motion, if `trajectory` has a correction learned at the tool; else ''.

    """

    def __init__(self, machine, motion, law, trajectory, planned=''):
        self._machine, self._motion, self._law, self._trajectory = machine, motion, law, trajectory
        self._planned = planned
        self._rows = {}

    def observe(self, joint, gains, error, feedforward, iteration):
        """
        Take a cycle of `joint` with `error` (N,) [m] under `feedforward` (N,) [V] in the loop of `gains`.

        `iteration` 0 restarts learning of the joint: the previous best is discarded.
        """
        rms, kept = float(np.sqrt(np.mean(np.square(error)))), self._rows.get(joint)
        if kept is None or iteration == 0 or rms < kept.error:
            self._rows[joint] = _Row(rms, gains, np.array(feedforward, dtype=np.float64))

    def learned(self):
        """
        Return the best feedforward of all joints as `Learned`, for `store.save`.

        Raises
        ------
        LearningError
            If a joint has had no cycle.

        """
        machine = self._machine
        missing = [joint for joint in machine.joints if joint not in self._rows]
        if missing:
            raise LearningError(
                f'motion {self._motion!r}, law {self._law!r}: no cycle of {missing} yet; expected one of every joint'
            )
        rows = {joint: self._rows[joint] for joint in machine.joints}
        gains = {joint: row.gains for joint, row in rows.items()}
        law = make_law(self._law, machine, gains).with_reference(self._trajectory)
        parameters = {}
        if isinstance(law, BasisLaw):
            parameters = {joint: law.parameters(joint, row.feedforward) for joint, row in rows.items()}
        origin = origin_of(machine, self._motion, self._law, gains, self._trajectory)
        if self._planned:
            origin = replace(origin, reference=self._planned)
        return Learned(origin, np.stack([row.feedforward for row in rows.values()], axis=1), parameters)
