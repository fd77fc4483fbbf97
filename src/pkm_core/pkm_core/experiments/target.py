"""One row of `pkm experiment targets`."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """One target: subject, value of the thesis, goal, value reached, and whether it is met (None: reported only)."""

    what: str
    thesis: str
    goal: str
    reached: str
    met: bool | None
