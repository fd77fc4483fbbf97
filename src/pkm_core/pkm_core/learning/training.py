"""Motion that makes all parameters of the basis law identifiable."""

from scipy.linalg import hadamard

from pkm_core.motion.planning import Motion, Target


def training_motion(machine, length=5e-3, move_time=70e-3):
    """
    Return the `Motion` of a machine with 2, 4, 8, ... joints in which any two joints move in the same direction as
    often as in opposite directions.

    Each row of a Hadamard matrix gives the signs of a move by `length` [m] away from home and back; then all rows are
    repeated with opposite signs. Accelerations of partners are orthogonal over a cycle, and every joint moves on both
    sides of home.
    """
    signs = hadamard(len(machine.joints))
    moves = [way * side * length * row for side in (1, -1) for row in signs for way in (1, -1)]
    by = [dict(zip(machine.joints, move.tolist(), strict=True)) for move in moves[:-1]]  # planning adds the last move
    return Motion(machine=machine.name, targets=tuple(Target(by=each) for each in by), move_time=move_time)
