"""
Figures 7.15 to 7.29 and 8.16 to 8.42 from the runs of the first noise seed in the nominal environment.

Most captions are missing in the text of the thesis. Number and order of the figures follow from the others:
sensitivity, tracking, error and driving current of each actuator, then end point, convergence and settling.
"""

from itertools import count

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pkm_core.control.margin_plots import draw_sensitivity, model_loops
from pkm_core.control.model import load_model
from pkm_core.experiments.condition import prepared
from pkm_core.machines.checks import ANGLES
from pkm_core.reporting.histories import end_point_histories, joint_histories, laser_histories

FIRST = {'planar': (7, 15), 'four_dof': (8, 16)}  # chapter and number of the first figure
CONTROLS = ('computed torque', 'robust', 'thesis law')  # the thesis's three
AFTER = 60.0  # [ms] of rest in the settling figures
_TIME = 'time [ms]'


def plot_study(study, folder):
    """Draw every figure of a `Study` into `folder` and return {number: (file, subject)}."""
    runs = {name: study.outcomes[name, 'nominal'][0] for name in CONTROLS}
    learned = runs[CONTROLS[-1]]
    machine = prepared(learned.condition).machine
    chapter, first = FIRST[study.experiment]
    numbers, made = count(first), {}

    def draw(what, drawing, *arguments, rows=1, width=7.5):
        number = f'{chapter}.{next(numbers)}'
        path = folder / f'fig_{number.replace(".", "_")}.png'
        figure = Figure(figsize=(width, 1.2 + 2.4 * rows), layout='constrained')
        FigureCanvasAgg(figure)
        figure.suptitle(f'{study.experiment}: {what} (corresponds to Fig. {number})', fontsize='medium')
        drawing(figure, *arguments)
        figure.savefig(path, dpi=100)
        made[number] = (path, what)

    joints, coordinates = machine.joints, machine.coordinates
    for joint in joints:
        draw(f'sensitivity of the loop of {joint}', _sensitivity, runs['robust'].condition, joint)
    for column, joint in enumerate(joints):
        draw(f'position tracking of {joint}', _tracking, learned, column)
    for column, joint in enumerate(joints):
        draw(f'position error of {joint}', _errors, runs, column)
    for column, joint in enumerate(joints):
        draw(f'driving current of {joint}', _currents, runs, machine, column)
    if study.experiment == 'planar':  # chapter 7 has convergence before the end point
        draw('convergence of the largest error of each actuator', _convergence, study, rows=1.5)
    draw('path of the end point by forward kinematics', _path, learned, machine, rows=1.8)
    if study.experiment == 'four_dof':
        for names in (coordinates[:3], coordinates[3:]):
            draw(f'command of {", ".join(names)}', _command, learned, machine, names, rows=0.8 * len(names))
    for column, name in enumerate(coordinates):
        draw(f'error of the end point in {name} by forward kinematics', _pose_errors, runs, machine, column)
    if study.experiment == 'four_dof':
        draw('convergence of the largest error of each actuator', _convergence, study, rows=1.5)
    for name, run in runs.items():
        draw(f'settling of the end point, {name}', _settling, run, machine, rows=1.2 * len(coordinates))
    return made


def _milliseconds(histories):
    return 1e3 * histories.sample_time * np.arange(len(histories.error))


def _finish(axes, ylabel, xlabel=_TIME):
    axes.set(xlabel=xlabel, ylabel=ylabel)
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(fontsize='small', loc='upper right')


def _sensitivity(figure, condition, joint):
    machine, axis_gains = prepared(condition).machine, prepared(condition).gains[joint]
    draw_sensitivity(figure.subplots(), *model_loops(axis_gains, load_model(machine)[joint], machine.sample_time))


def _tracking(figure, run, column):
    histories = joint_histories(run.shown[1])
    axes, time = figure.subplots(), _milliseconds(histories)
    axes.plot(time, 1e3 * histories.measured[:, column], label='measured')
    axes.plot(time, 1e3 * histories.reference[:, column], '--', color='k', linewidth=0.8, label='reference')
    axes.ticklabel_format(useOffset=False)
    _finish(axes, f'{histories.names[column]} [mm]')


def _errors(figure, runs, column):
    axes = figure.subplots()
    for name, run in runs.items():
        histories = joint_histories(run.shown[1])
        axes.plot(_milliseconds(histories), 1e6 * histories.error[:, column], linewidth=0.9, label=name)
    _finish(axes, f'error of {histories.names[column]} [um]')


def _currents(figure, runs, machine, column):
    axes, gain = figure.subplots(), machine.config.drive.amplifier_gain
    for name, run in runs.items():
        histories = joint_histories(run.shown[1])
        axes.plot(_milliseconds(histories), gain * run.shown[1].voltage[:, column], linewidth=0.9, label=name)
    _finish(axes, f'current of {histories.names[column]} [A]')


def _path(figure, run, machine):
    histories = end_point_histories(run.shown[1], machine)
    spatial = histories.measured.shape[1] > 2
    axes = figure.add_subplot(projection='3d') if spatial else figure.add_subplot()
    length = slice(0, 3 if spatial else 2)
    axes.plot(*(1e3 * histories.measured[:, length].T), label='measured')
    axes.plot(*(1e3 * histories.reference[:, length].T), '--', color='k', linewidth=0.8, label='reference')
    axes.set(xlabel='x [mm]', ylabel='y [mm]')
    if spatial:
        axes.set_zlabel('z [mm]')
    else:
        axes.set_aspect('equal', adjustable='datalim')
    axes.legend(fontsize='small')


def _command(figure, run, machine, names):
    histories = end_point_histories(run.shown[1], machine)
    for axes, name in zip(figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0], names, strict=True):
        angle = name in ANGLES
        values = histories.reference[:, histories.names.index(name)]
        axes.plot(_milliseconds(histories), np.degrees(values) if angle else 1e3 * values, color='k')
        axes.ticklabel_format(useOffset=False)
        _finish(axes, f'{name} [{"deg" if angle else "mm"}]')


def _pose_errors(figure, runs, machine, column):
    axes = figure.subplots()
    for name, run in runs.items():
        histories = end_point_histories(run.shown[1], machine)
        axes.plot(_milliseconds(histories), 1e6 * histories.error[:, column], linewidth=0.9, label=name)
    _finish(axes, f'error of {histories.names[column]} [um]')


def _convergence(figure, study):
    axes = figure.subplots()
    for name in (each.name for each in study.conditions(study.experiment) if each.law != 'none'):
        outcomes = study.outcomes[name, 'nominal']
        for column, joint in enumerate(outcomes[0].joints):
            error = 1e6 * np.mean([each.encoders['max_dynamic_error'][:, column] for each in outcomes], axis=0)
            style = '-o' if name == CONTROLS[-1] else ':s'
            axes.semilogy(
                np.arange(len(error)) + 1, error, style, color=f'C{column}', markersize=3, label=f'{joint}, {name}'
            )
    _finish(axes, 'max dynamic error [um]', 'cycle')


def _settling(figure, run, machine):
    """Draw the error by the laser (grey) after the end of the first profile, and the currents of all drives (black)."""
    record = run.shown[1]
    histories = laser_histories(record) or end_point_histories(record, machine)
    gain, start = machine.config.drive.amplifier_gain, record.move_ends[0]
    rows = figure.subplots(len(histories.names), 1, sharex=True, squeeze=False)[:, 0]
    for column, axes in enumerate(rows):
        axes.plot(
            _milliseconds(histories) - 1e3 * start * record.sample_time, 1e6 * histories.error[:, column], color='0.6'
        )
        axes.axhspan(-5, 5, color='C2', alpha=0.1)
        axes.axvline(0, color='k', linewidth=0.8, linestyle=':')
        _finish(axes, f'{histories.names[column]} [um]', 'time after the end of the profile [ms]')
        currents = axes.twinx()
        time = 1e3 * record.sample_time * (np.arange(len(record.voltage)) - start)
        currents.plot(time, gain * record.voltage, color='k', linewidth=0.5)
        currents.set(ylabel='[A]', xlim=(-10.0, AFTER), ylim=(-0.6, 0.6))
