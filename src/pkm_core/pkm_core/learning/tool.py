"""Learning at the tool from cycle to cycle: correction, monitor, and the fall back to the joints."""

import numpy as np

from pkm_core.control.model import load_model
from pkm_core.errors import LearningError, PkmError
from pkm_core.learning.law import require_robust
from pkm_core.learning.monitor import Monitor
from pkm_core.learning.store import design_hash
from pkm_core.learning.tool_convergence import check_tool_law
from pkm_core.learning.tool_law import ToolLaw, load_tool_law
from pkm_core.motion.trajectory import added, checked_cycle

# verdicts of laws that have passed their test, by everything it depends on
_passed: dict[tuple, str] = {}


def make_tool_law(machine, gains, law, poses, joints, name='laser'):
    """
    Return the `ToolLaw` of config/learning/tool/NAME.yaml for one motion, after its convergence test.

    Parameters
    ----------
    machine : Machine
        The calibrated machine, if there is one.
    gains : dict of str to RobustGains
        Of the loops.
    law : Law or None
        That of the joints, which learns beside it.
    poses, joints : SampledTrajectory
        The motion as planned.
    name : str or Path
        Of the file.

    Raises
    ------
    LearningError
        If it diverges, the gains are not those of robust control, or the laser is too slow.
    ConfigError
        If the file is refused.

    """
    require_robust(gains)
    config, models = load_tool_law(machine, name), load_model(machine)
    of_joints = (type(law), law.config.model_dump_json()) if law else None
    key = config.model_dump_json(), design_hash(machine.drawing, gains), of_joints
    if key not in _passed:
        _passed[key] = check_tool_law(config, machine, gains, models, law)
    return ToolLaw(config, machine, poses, joints, _passed[key])


class ToolLearning:
    """
    The correction of the reference of one motion.

    Parameters
    ----------
    law : ToolLaw

    Attributes
    ----------
    correction : ndarray, shape (N, n)
        Of the next cycle [m].
    motion : SampledTrajectory
        The correction with its derivatives.
    reference : SampledTrajectory
        In joints, of the next cycle: the planned motion plus `motion`.

    """

    def __init__(self, law):
        self.law = law
        self._monitor, self._iteration = Monitor('the tool', signal='correction'), 0
        self._held = ''  # why the last cycle changed nothing
        self.correction = np.zeros_like(law.joints.position)
        self.motion, self.reference = law.motion_of(self.correction), law.joints

    @property
    def is_held(self):
        """Whether the last cycle changed nothing, because a measurement was missing or a limit would be exceeded."""
        return bool(self._held)

    def hold(self, reason):
        """Keep the correction for another cycle; return a notice in the first of several such cycles, else ''."""
        held, self._held = self._held, reason
        return '' if held else f'learning at the tool: {reason}; the correction is kept, only the joints learn'

    def after_cycle(self, error, first_tick, time, displacement):
        """
        Learn from a cycle and return a notice, '' if there is none.

        Without a complete record of the laser, or if the next reference would exceed a limit of the machine, the
        correction is kept, and only the joints learn. The notice is given in the first such cycle and after the last.

        Parameters
        ----------
        error : ndarray, shape (N, n)
            By the encoders [m].
        first_tick, time, displacement
            As for `ToolLaw.tool_error`.

        """
        try:
            tool_error = self.law.tool_error(first_tick, time, displacement)
            if error.shape != tool_error.shape or not np.isfinite(error).all():
                raise LearningError(f'encoder errors {error.shape}; expected finite values of shape {tool_error.shape}')
            message = self._learn(tool_error, error)
        except PkmError as reason:
            return self.hold(str(reason))
        back, self._held = 'learning at the tool continues' if self._held else '', ''
        return '; '.join(filter(None, [back, message]))

    def _learn(self, tool_error, error):
        decision = self._monitor.observe(tool_error, self.correction)
        self._iteration = min(self._iteration, decision.iteration)
        following = decision.feedforward
        if decision.learn:
            following = self.law.update(following, tool_error, error, self._iteration)
        motion = self.law.motion_of(following)
        reference = checked_cycle(self.law.machine, added(self.law.joints, motion))
        self.correction, self.motion, self.reference = following, motion, reference
        self._iteration += decision.learn
        return decision.message
