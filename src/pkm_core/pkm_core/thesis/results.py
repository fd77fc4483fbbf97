"""Results of the thesis for comparison with ours: Tables 7.2, 7.3, 8.2 and 8.3."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ReportedTable:
    """A table of the thesis: one value per column for each quantity and axis; None if the cell is not legible."""

    title: str
    columns: tuple[str, ...]
    values: dict[str, dict[str, tuple[float | None, ...]]]


_CONTROLLERS = ('computed torque', 'robust', 'robust learning')

# by machine; encoders
JOINT_SPACE = {
    'planar': ReportedTable(
        'Table 7.2',
        _CONTROLLERS,
        {
            'max_dynamic_error_um': {'d1': (136.4, 13.4, 4.4), 'd3': (84.4, 14.0, 9.4)},
            'settling_5um_ms': {'d1': (36.5, 2.0, None), 'd3': (9.5, None, None)},
            # -1.5, -0.2, -1.0, -1.0 are legible; their cells are unknown
            'steady_state_error_um': {'d1': (None, None, None), 'd3': (None, None, None)},
        },
    ),
    'four_dof': ReportedTable(
        'Table 8.2',
        _CONTROLLERS,
        {
            'max_dynamic_error_um': {
                'd1': (140.2, 22.4, 5.0),
                'd3': (82.2, 9.2, 4.4),
                'd5': (154.0, 22.2, 7.0),
                'd7': (140.2, 47.0, 5.6),
            },
            'settling_5um_ms': {
                'd1': (30.0, 5.0, None),
                'd3': (30.5, 3.0, None),
                'd5': (34.0, 8.0, None),
                'd7': (34.0, 3.0, None),
            },
            # eleven values are legible in this order; the missing one, a zero, most likely belongs to the None
            'steady_state_error_um': {
                'd1': (-1.6, -2.4, -0.6),
                'd3': (-1.0, 0.2, 0.8),
                'd5': (-0.4, 0.4, None),
                'd7': (-1.6, -0.6, -0.6),
            },
        },
    ),
}

# by machine; laser, phi as the displacement it causes. The zeros of settling are from the text of the thesis.
END_POINT = {
    'xy_stage': ReportedTable(
        'Table 7.3',
        ('XY stage',),
        {'settling_5um_ms': {'x': (28.0,), 'y': (22.0,)}, 'steady_state_error_um': {'x': (6.0,), 'y': (8.0,)}},
    ),
    'planar': ReportedTable(
        'Table 7.3',
        ('XY stage', *_CONTROLLERS),
        {
            'settling_5um_ms': {'x': (28.0, 48.0, 16.0, 8.8), 'y': (22.0, 60.0, 0.0, None)},
            'steady_state_error_um': {'x': (6.0, 1.82, 1.37, -0.91), 'y': (8.0, 2.73, 1.09, 0.91)},
        },
    ),
    'four_dof': ReportedTable(
        'Table 8.3',
        ('single stages', *_CONTROLLERS),
        {
            'settling_5um_ms': {
                'x': (28.0, 51.2, 27.2, 0.0),
                'y': (22.0, 49.6, 36.8, 0.0),
                'z': (18.0, 36.8, 7.2, 0.0),
                'phi': (23.0, 54.4, 24.0, 4.8),
            },
            'steady_state_error_um': {
                'x': (6.0, None, 0.0, None),
                'y': (8.0, 0.91, 0.91, 0.91),
                'z': (5.5, -0.91, 0.0, -0.91),
                'phi': (4.8, -1.82, -1.82, 1.82),
            },
        },
    ),
}
