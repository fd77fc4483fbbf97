"""What `pkm run` is to do, checked before any process starts. Libraries are imported where they are used."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pkm_core.config import find_config
from pkm_core.errors import PkmError

# default law by kind of control; none for others
DEFAULT_LAWS = {'robust': 'fourier_pid', 'observer': 'inverse'}


@dataclass(frozen=True)
class RunGoal:
    """A motion, its number of cycles, and the law that learns."""

    machine: Any  # a `Machine`
    motion: str
    cycles: int
    law: str
    learned: Path | None
    save_learned: Path | None
    still: str  # moves in which nothing moves

    @property
    def files(self):
        """Folders that the cell may use because the user named files in them, as keywords of `CellProcesses`."""
        from pkm_core.learning import law_file

        law = '' if self.law == 'none' else str(law_file(self.law).resolve().parent)
        return {'plugins': law, 'learned': self.save_learned.resolve().parent if self.save_learned else ''}

    def hashes_of_files(self, machine_name, cell):
        """
        Return the configuration hashes that the files, as they are now, may have; `cell` is the options of the cell.

        They are one with the truth of the simulated machine and, if another machine may run, one without.
        """
        from pkm_core.recording.provenance import config_hash, loop_hash, machine_hash, truth_hash

        loops = [loop_hash(self.machine, cell['control'], machine_hash(machine_name))]
        learns_at_tool = cell['learning_target'] == 'tool' and 'tool_learning' not in cell['without']
        tool_law = {'tool_law': 'laser'} if learns_at_tool else {}
        found = {config_hash([*loops, truth_hash(self.machine)], Path(self.motion).stem, self.law, **tool_law)}
        if 'machine' in cell['without']:
            found.add(config_hash(loops, Path(self.motion).stem, self.law, **tool_law))
        return found

    @classmethod
    def checked(cls, machine_name, motion, cycles, law, controller, learned, save_learned, learning_target):
        """Return the goal of these options of the verb; `PkmError` if the cell would refuse it."""
        from pkm_core.machines import load_machine
        from pkm_core.motion.planning import default_motion, load_motion, plan, still_moves
        from pkm_core.motion.trajectory import to_joints

        for kind, name in (('machines', machine_name), ('motions', motion)):
            if name:
                find_config(kind, name)  # an unknown name is refused before units and models are loaded
        machine = load_machine(machine_name)
        motion = motion or default_motion(machine)
        poses = plan(machine, load_motion(motion))
        joints = to_joints(machine, poses)
        law = _checked_law(machine, poses, joints, law, controller, learning_target)
        if save_learned:
            from pkm_core.learning.store import check_replaceable

            if law == 'none':
                raise PkmError('--save-learned: given with --law none, which learns nothing; expected a learning law')
            check_replaceable(save_learned)
        if learned:
            from pkm_core.control.controllers import choose_control
            from pkm_core.learning.initial import first_feedforward

            gains = choose_control(machine, controller)
            first_feedforward(learned, machine, Path(motion).stem, law, gains, joints)
        return cls(machine, motion, cycles, law, learned, save_learned, still_moves(machine, joints))


def _checked_law(machine, poses, joints, law, controller, learning_target):
    """Return the name of the learning law, `law` or the default of the controller."""
    from pkm_core.control.controllers import SINGLE_AXIS, choose_control, kind_of
    from pkm_core.learning import law_file, make_law

    gains = choose_control(machine, controller)
    kind = kind_of(gains)
    law = law or DEFAULT_LAWS.get(kind, 'none')
    if law != 'none':
        law_file(law)
        if kind not in SINGLE_AXIS:
            raise PkmError(f'--law: {law!r} given; --controller {controller} does not learn, expected none')
    if learning_target == 'tool':
        if law == 'none':
            raise PkmError('--learning-target: tool given with --law none, which learns nothing; expected a law')
        from pkm_core.learning.tool import make_tool_law

        make_tool_law(machine, gains, make_law(law, machine, gains), poses, joints)
    return law
