"""
The figures of a run, and of two runs side by side.

Each function draws one column per run and one row per axis, and returns a matplotlib `Figure`. The first cycle is grey,
the last blue. The docstring is the caption on the page. matplotlib is imported in the functions: it takes 0.5 s.
"""

import numpy as np

from pkm_core.machines.checks import ANGLES
from pkm_core.reporting.histories import end_point_histories, joint_histories, laser_histories
from pkm_core.reporting.spectrum import amplitude_spectrum
from pkm_core.reporting.summary import first_and_last

_TIME = 'time [ms]; moves are shaded'
_AFTER = 'time after the end of the profile [ms]'
# [ms] range of the settling figures, from the end of a profile
_SETTLING = (-10.0, 60.0)
_TOLERANCE = 5.0  # [um] band of settling
_SETTLING_CURRENT = 0.05  # range of the current in these figures [peak current of the drive]


def error_over_cycles(runs):
    """Largest dynamic error of every axis by cycle."""
    return _by_axis(runs, lambda run: ['all axes'], _draw_convergence, 'cycle', 'max dynamic error [um]', height=3.6)


def tracking(runs):
    """Reference and measured position of every joint in the last cycle."""
    return _by_axis(runs, _joints, _draw_tracking, _TIME, '{} [mm]')


def pose_tracking(runs):
    """Reference and measured pose in the last cycle, by forward kinematics of the encoders."""
    return _by_axis(runs, _coordinates, _draw_pose, _TIME, '{} [{unit}]')


def error(runs):
    """Error of every joint in the first and the last cycle."""
    return _by_axis(runs, _joints, lambda axes, run, row: _draw_error(axes, run.records, row), _TIME, '{} [um]')


def spectrum(runs):
    """Amplitude spectrum of the error of every joint in the first and the last cycle."""
    return _by_axis(runs, _joints, _draw_spectrum, 'frequency [Hz]', '{} [um]')


def voltage(runs):
    """Voltage of every drive and its learned part; the right scale is the current of the amplifier."""
    return _by_axis(runs, _joints, _draw_voltage, _TIME, '{} [V]')


def settling(runs):
    """Error of every joint after each move and current of its drive, in the form of Fig. 7.27 to 7.29."""
    return _by_axis(runs, _joints, _draw_settling, _AFTER, '{} [um]')


def end_point(runs):
    """Error of the end point after each move, by the encoders and, if present, by the laser."""
    return _by_axis(runs, _coordinates, _draw_end_point, _AFTER, '{} [um]')


def plot_cycles(records, path):
    """Draw the error by cycle, and the error over time of the first and last cycle, into the PNG `path`."""
    joints = records[0].joints
    figure = _figure(11, 2.2 + 1.5 * len(joints))
    left, right = figure.subfigures(1, 2, width_ratios=[2, 3])
    axes = left.subplots()
    _draw_cycles(axes, records)
    axes.set(xlabel='cycle', ylabel='max dynamic error [um]')
    axes.set_title(f'{records[0].motion}, law {records[-1].learning_law}')
    rows = right.subplots(len(joints), 1, sharex=True, squeeze=False)[:, 0]
    for row, (joint, axes) in enumerate(zip(joints, rows, strict=True)):
        _draw_error(axes, records, row)
        axes.set_ylabel(f'{joint} [um]')
        axes.grid(alpha=0.3)
    rows[-1].set_xlabel(_TIME)
    rows[0].set_title('error, reference minus encoder')
    rows[0].legend(ncols=2, loc='upper right', fontsize='small')
    figure.savefig(path, dpi=110)


# ---- the grid


def _joints(run):
    return run.records[-1].joints


def _coordinates(run):
    return run.records[-1].coordinates


def _figure(width, height):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure


def _by_axis(runs, names_of, draw, xlabel, ylabel, height=1.6):
    """Return a figure with ``draw(axes, run, row)`` for each run and axis; runs share the scales of a row."""
    names = [names_of(run) for run in runs]
    rows = max(map(len, names))
    figure = _figure(5.0 + 5.0 * len(runs), 1.0 + height * rows)
    grid = figure.subplots(rows, len(runs), sharex='col', sharey='row', squeeze=False)
    for column, run in enumerate(runs):
        for row, name in enumerate(names[column]):
            axes = grid[row, column]
            draw(axes, run, row)
            axes.grid(which='both', alpha=0.3)
            axes.set_ylabel(ylabel.format(name, unit='deg' if name in ANGLES else 'mm'))
            axes.tick_params(labelleft=True)
        for axes in grid[len(names[column]) :, column]:
            axes.remove()  # the other machine has more axes
        axes = grid[len(names[column]) - 1, column]
        axes.set_xlabel(xlabel)
        axes.tick_params(labelbottom=True)
        grid[0, column].set_title(f'{run.name}: {run.records[-1].learning_law}')
        grid[0, column].legend(ncols=4, loc='upper right', fontsize='small')
    return figure


# ---- the panels


def _shown(records):
    """Return (cycle, colour) of the first and the last cycle."""
    shown = first_and_last(records)
    return list(zip(shown, ('0.6', 'C0')[-len(shown) :], strict=True))


def _milliseconds(history, start=0):
    return 1e3 * history.sample_time * (np.arange(len(history.error)) - start)


def _shade_moves(axes, record):
    for start, end in zip(record.move_starts, record.move_ends, strict=True):
        axes.axvspan(1e3 * start * record.sample_time, 1e3 * end * record.sample_time, color='0.93')


def _draw_cycles(axes, records):
    worst = np.array([[1e6 * axis.max_dynamic_error for axis in record.metrics()] for record in records])
    for joint, errors in zip(records[0].joints, worst.T, strict=True):
        axes.semilogy([record.cycle for record in records], errors, marker='o', markersize=4, label=joint)
    axes.grid(which='both', alpha=0.3)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend()


def _draw_convergence(axes, run, row):
    _draw_cycles(axes, run.records)


def _draw_reference(axes, histories, row, scale):
    axes.plot(_milliseconds(histories), scale * histories.measured[:, row], color='C0', linewidth=1.6, label='measured')
    style = {'color': '0.0', 'linewidth': 0.8, 'linestyle': '--'}
    axes.plot(_milliseconds(histories), scale * histories.reference[:, row], label='reference', **style)
    axes.ticklabel_format(useOffset=False)


def _draw_tracking(axes, run, row):
    _shade_moves(axes, run.records[-1])
    _draw_reference(axes, joint_histories(run.records[-1]), row, 1e3)


def _draw_pose(axes, run, row):
    _shade_moves(axes, run.records[-1])
    histories = end_point_histories(run.records[-1], run.machine)
    _draw_reference(axes, histories, row, np.degrees(1.0) if histories.names[row] in ANGLES else 1e3)


def _draw_error(axes, records, row):
    _shade_moves(axes, records[0])
    for record, colour in _shown(records):
        style = {'color': colour, 'linewidth': 0.9, 'label': f'cycle {record.cycle}'}
        axes.plot(_milliseconds(record), 1e6 * record.error[:, row], **style)


def _draw_spectrum(axes, run, row):
    for record, colour in _shown(run.records):
        frequency, amplitude = amplitude_spectrum(1e6 * record.error, record.sample_time)
        style = {'color': colour, 'linewidth': 0.9, 'label': f'cycle {record.cycle}'}
        axes.loglog(frequency[1:], amplitude[1:, row], **style)
    axes.set_ylim(bottom=1e-4)  # 1/2000 of an encoder count; lower values are rounding


def _draw_voltage(axes, run, row):
    _shade_moves(axes, run.records[0])
    for record, colour in _shown(run.records):
        style = {'color': colour, 'linewidth': 0.9, 'label': f'cycle {record.cycle}'}
        axes.plot(_milliseconds(record), record.voltage[:, row], **style)
    last = run.records[-1]
    axes.plot(_milliseconds(last), last.feedforward[:, row], color='C1', linewidth=0.9, label='learned part')
    gain = run.machine.config.drive.amplifier_gain
    right = axes.secondary_yaxis('right', functions=(lambda volts: gain * volts, lambda amperes: amperes / gain))
    right.set_ylabel('[A]')


def _draw_rests(axes, histories, values, **style):
    """Draw one line of `values` (N,) per move of `histories`: around its end and in the rest after it."""
    stops = [*histories.move_starts[1:], len(values)]
    starts = [0, *stops[:-1]]
    for start, end, stop in zip(starts, histories.move_ends, stops, strict=True):
        time = _milliseconds(histories, end)
        seen = (time >= _SETTLING[0]) & (time <= _SETTLING[1])
        seen[:start] = seen[stop:] = False
        axes.plot(time[seen], values[seen], **style)
        style.pop('label', None)  # one legend entry for all moves


def _draw_tolerance(axes):
    axes.axhspan(-_TOLERANCE, _TOLERANCE, color='C2', alpha=0.12)
    axes.axvline(0.0, color='0.0', linewidth=0.8, linestyle=':')
    axes.set_xlim(_SETTLING)


def _draw_settling(axes, run, row):
    _draw_tolerance(axes)
    for record, colour in _shown(run.records):
        style = {'color': colour, 'linewidth': 0.9, 'label': f'cycle {record.cycle}'}
        _draw_rests(axes, joint_histories(record), 1e6 * record.error[:, row], **style)
    drive, last = run.machine.config.drive, run.records[-1]
    right = axes.twinx()
    style = {'color': '0.0', 'linewidth': 0.6, 'linestyle': '--'}
    _draw_rests(right, joint_histories(last), drive.amplifier_gain * last.voltage[:, row], **style)
    right.set_ylim(-_SETTLING_CURRENT * drive.peak_current, _SETTLING_CURRENT * drive.peak_current)
    right.set_ylabel('[A]')
    axes.plot([], [], label=f'current, cycle {last.cycle}', **style)


def _draw_end_point(axes, run, row):
    _draw_tolerance(axes)
    for record, colour in _shown(run.records):
        encoders, laser = end_point_histories(record, run.machine), laser_histories(record)
        style = {'color': colour, 'linewidth': 0.9, 'label': f'cycle {record.cycle}'}
        _draw_rests(axes, encoders, 1e6 * encoders.error[:, row], **style)
        if laser is not None:
            style = {'color': colour, 'linestyle': '', 'marker': 'o', 'markersize': 2.5}
            _draw_rests(axes, laser, 1e6 * laser.error[:, row], label=f'cycle {record.cycle}, laser', **style)
