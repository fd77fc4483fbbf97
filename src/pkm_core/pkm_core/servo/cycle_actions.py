"""Actions of `CycleRun`, which the machine performs."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SendSamples:
    """Send the encoder samples of the current tick and open the barrier."""


@dataclass(frozen=True, slots=True)
class SendExtended:
    """As `SendSamples`, with the first sample of a piece that extends a jog."""


@dataclass(frozen=True, slots=True)
class Extend:
    """Report that the next piece extends the cycle to `samples`."""

    cycle: int
    samples: int


@dataclass(frozen=True, slots=True)
class AwaitTurn:
    """Call `CycleRun.turn` when the current tick is due in wall time."""


@dataclass(frozen=True, slots=True)
class Start:
    """Start the cycle; its first samples follow at once, or after a pause. `hold` is that of a jog, otherwise 0."""

    cycle: int
    samples: int
    hold: int = 0


@dataclass(frozen=True, slots=True)
class Finish:
    """Report that the last tick of the cycle has run."""

    cycle: int
    samples: int


@dataclass(frozen=True, slots=True)
class Refuse:
    """Report that the cycle does not start."""

    cycle: int
    reason: str


@dataclass(frozen=True, slots=True)
class StopSafely:
    """Brake without the controllers and report the fault; `samples` ticks of the cycle have run."""

    cycle: int
    samples: int
    reason: str


@dataclass(frozen=True, slots=True)
class GoHome:
    """Set the machine to its home position; `message` answers the reset request."""

    cycle: int
    message: str


@dataclass(frozen=True, slots=True)
class RefuseReset:
    """Answer the reset request with a refusal."""

    message: str
