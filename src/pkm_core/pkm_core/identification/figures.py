"""The figures of an identification: moves against the model (Fig. 7.9, 8.4) and Bode plot (Fig. 7.11, 8.8)."""

import numpy as np

from pkm_core.identification.prediction import moving_stretches, predict
from pkm_core.plotting import new_figure, save

# numbers of the thesis's figures, in the order of the joints
_MOVES = {'planar': ('7_9', '7_10'), 'four_dof': ('8_4', '8_5', '8_6', '8_7')}
_RESPONSES = {'planar': ('7_11', '7_12'), 'four_dof': ('8_8', '8_9', '8_10', '8_11')}


def draw_identification(folder, machine, found):
    """Write the figures of {joint: AxisIdentification} into `folder`; `machine` is None for an axis of another cell."""
    for joint, axis in found.items():
        draw_moves(folder, _name(_MOVES, machine, joint, 'moves'), axis)
        if axis.high:
            draw_response(folder, _name(_RESPONSES, machine, joint, 'response'), axis)


def _name(numbers, machine, joint, what):
    mechanism = machine and machine.config.mechanism
    if mechanism not in numbers:
        return f'{what}_{joint}'
    return f'fig_{numbers[mechanism][machine.joints.index(joint)]}_{what}_{joint}'


def draw_moves(folder, name, axis):
    """Draw measured and predicted position over every stretch of motion, and the difference."""
    low = axis.low
    figure = new_figure(9.0, 6.0)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    shift = 0.0
    for data in axis.moves:
        stretches = moving_stretches(data)
        for stretch, prediction in zip(stretches, predict(stretches, low.viscosity, axis.low_known), strict=True):
            count = len(prediction.measured)
            time = 1e3 * (shift + data.sample_time * np.arange(count))
            error, origin = prediction.error(low.gain), data.position[stretch.start]
            above.plot(time, 1e3 * (origin + prediction.measured), color='0.6', linewidth=3)
            above.plot(time, 1e3 * (origin + prediction.measured - error), color='k', linewidth=1)
            below.plot(time, 1e6 * error, color='C3', linewidth=0.8)
            shift += data.sample_time * (count + 10)
    above.set(ylabel='position [mm]', title=f'{axis.joint}: encoder (grey) and L = K/(s (s + a)) (black)')
    gain_deviation, viscosity_deviation = low.deviations
    above.annotate(
        f'K = {low.gain:.4g} $\\pm$ {gain_deviation:.2g} m/s$^2$/V\n'
        f'a = {low.viscosity:.2f} $\\pm$ {viscosity_deviation:.2f} 1/s\nfit of held-out moves {low.fit_percent:.2f} %',
        (0.01, 0.97),
        xycoords='axes fraction',
        va='top',
    )
    below.set(ylabel='difference [um]', xlabel='time of motion, without rests [ms]')
    for axes in (above, below):
        axes.grid(alpha=0.3)
    return save(figure, folder, name)


def draw_response(folder, name, axis):
    """Draw acceleration over drive at every position, the model at the lowest gain, and the coherence."""
    figure = new_figure(8.0, 8.0)
    magnitude, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=[3, 2, 1])
    chosen = axis.responses[axis.lowest]
    for response in (*axis.responses, chosen):
        style = {'color': 'k', 'marker': '.', 'linestyle': 'none'} if response is chosen else {'color': '0.75'}
        acceleration = _acceleration(response.frequency, response.plant, axis.high_known)
        magnitude.plot(response.frequency, 20 * np.log10(np.abs(acceleration)), markersize=3, **style)
        phase.plot(response.frequency, np.degrees(np.unwrap(np.angle(acceleration))), markersize=3, **style)
        coherence.plot(response.frequency, response.coherence, markersize=3, **style)
    gain = axis.high.gains[min(axis.lowest, len(axis.high.gains) - 1)]
    grid = np.linspace(chosen.frequency[0], chosen.frequency[-1], 2000)
    model = axis.high_known.response(grid, gain, axis.high.delay, axis.high.modes)
    model = _acceleration(grid, model, axis.high_known)
    magnitude.plot(grid, 20 * np.log10(np.abs(model)), 'C3', linewidth=1)
    phase.plot(grid, np.degrees(np.unwrap(np.angle(model))), 'C3', linewidth=1)
    magnitude.set(
        ylabel='acceleration over drive [dB re 1 m/s$^2$/V]',
        title=f'{axis.joint}: lowest gain (dots), other positions (grey), L H (red)',
    )
    phase.set(ylabel='phase, hold and\ncomputation removed [deg]')
    coherence.set(ylabel='coherence', xlabel='frequency [Hz]', ylim=(0, 1.05))
    for axes in (magnitude, phase, coherence):
        axes.grid(alpha=0.3)
    return save(figure, folder, name)


def _acceleration(frequency, plant, known):
    """Return the response of the acceleration without hold and computation."""
    s = 2j * np.pi * frequency
    hold = -np.expm1(-s * known.sample_time) / (s * known.sample_time)
    return s**2 * plant / hold * np.exp(s * known.sample_time * known.computation)
