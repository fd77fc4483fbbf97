"""What the thesis reports for its own machines, to stand beside ours: Tables 7.2 and 8.2 (encoder, joint space)."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ReportedAxis:
    """One axis of a table; None where the thesis's cell is lost."""

    robust_error: float  # [um] largest dynamic error under robust control
    learned_error: float  # [um] the same after learning
    robust_settling: float | None  # [ms] to +-5 um under robust control
    learned_settling: float | None  # [ms] after learning


REPORTED = {
    'planar': {
        'd1': ReportedAxis(13.4, 4.4, 2.0, None),
        'd3': ReportedAxis(14.0, 9.4, None, None),
    },
    'four_dof': {
        'd1': ReportedAxis(22.4, 5.0, 5.0, None),
        'd3': ReportedAxis(9.2, 4.4, 3.0, None),
        'd5': ReportedAxis(22.2, 7.0, 8.0, None),
        'd7': ReportedAxis(47.0, 5.6, 3.0, None),
    },
}
