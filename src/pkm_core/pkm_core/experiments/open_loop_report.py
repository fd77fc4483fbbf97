"""Results of the open-loop responses as numbers, CSV files and figures, in mm, deg and um."""

import csv

import numpy as np

from pkm_core.plotting import new_figure, save

# Two periods of the nominal design by an independent program: another formulation of the dynamics, tolerances 1e-10.
REFERENCE = {
    'i_a': {
        'net_mm': (18.82, 17.80, 20.69, 16.28),
        'amplitude_mm': (1.47, 1.55, 1.53, 1.49),
        'span_mm_deg': (8.64, 9.36, 3.85, 0.97),
        'leaves_travel_s': 0.1265,
    },
    'i_b': {
        'net_mm': (18.83, 17.87, 20.68, 16.30),
        'amplitude_mm': (1.47, 1.51, 1.53, 1.48),
        'span_mm_deg': (8.63, 9.36, 3.85, 1.00),
        'leaves_travel_s': 0.1271,
    },
    'ii_a': {
        'net_mm': (10.68, -9.08, 11.63, -9.11),
        'amplitude_mm': (0.85, 0.90, 0.86, 0.82),
        'span_mm_deg': (2.68, 2.53, 0.43, 6.98),
        'leaves_travel_s': None,
    },
    'ii_b': {
        'net_mm': (10.69, -9.08, 11.61, -9.08),
        'amplitude_mm': (0.85, 0.88, 0.86, 0.82),
        'span_mm_deg': (2.67, 2.53, 0.40, 6.97),
        'leaves_travel_s': None,
    },
}
_POSE_SCALE = np.array([1e3, 1e3, 1e3, np.degrees(1.0)])  # to mm and deg


def figures(machine, case, response):
    """
    Return the figures of one `Response` by name.

    Net displacement and end-effector span are those over the duration of the forces. The amplitude is that of the sine
    in the least-squares fit of constant, drift and sine to each joint.
    """
    driven = response.time <= case.duration * (1.0 + 1e-9)
    time, q, pose = response.time[driven], response.q[driven], response.pose[driven]
    phase = case.rate * time
    base = np.stack([np.ones_like(time), time, np.cos(phase), np.sin(phase)], axis=1)
    fit = np.linalg.lstsq(base, q, rcond=None)[0]
    joint, left = leaves_travel(machine, response.time, response.q)
    result = {
        'net_mm': 1e3 * (q[-1] - q[0]),
        'amplitude_mm': 1e3 * np.hypot(fit[2], fit[3]),
        'span_mm_deg': np.ptp(pose, axis=0) * _POSE_SCALE,
        'leaves_travel_s': left,
        'leaves_travel_joint': joint,
        'fault': response.fault,
    }
    if response.belts is not None:
        turn, last = np.degrees(np.abs(response.belts)), response.time > response.time[-1] - 0.01
        shift = 1e6 * np.linalg.norm(response.belt_shift[:, :3], axis=1)
        result['belts'] = {
            'largest_turn_deg': turn.max(),
            'turn_at_rest_deg': turn[last].max(),
            'largest_shift_um': shift.max(),
            'shift_at_rest_um': shift[last].max(),
            'largest_turn_of_end_point_urad': 1e6 * np.abs(response.belt_shift[:, 3]).max(),
        }
    return result


def difference_figures(response, rigid):
    """
    Return {'largest_um', 'rms_um'}, each (n,): joints of `response` minus those of the `rigid` model over the forces.

    Source: the differences of Fig. 6.11-6.14, there of measured and simulated positions.
    """
    apart = 1e6 * (response.q - _at(rigid, response.time))[response.time <= rigid.time[-1]]
    return {'largest_um': np.abs(apart).max(axis=0), 'rms_um': np.sqrt(np.mean(apart**2, axis=0))}


def _at(response, time):
    """Return the joint positions of a rigid `Response` at `time` (T,): splines, accurate to 1e-12 m."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(response.time, response.q)(time)


def leaves_travel(machine, time, q):
    """Return (joint, time [s]) of the first joint to leave its travel, or (None, None)."""
    beyond = np.maximum(q - machine.limits.upper, machine.limits.lower - q)
    outside = np.argwhere(beyond > 0.0)
    if not outside.size:
        return None, None
    row, joint = outside[0]
    if row == 0:
        return machine.joints[joint], float(time[0])
    share = beyond[row - 1, joint] / (beyond[row - 1, joint] - beyond[row, joint])
    return machine.joints[joint], float(time[row - 1] + share * (time[row] - time[row - 1]))


def write_csv(path, machine, response):
    """Write one row per sample to `path`: time, forces, joints, end point and, with belts, platform rotations."""
    units = ('deg' if name == 'phi' else 'mm' for name in machine.coordinates)
    heading = [
        'time_s',
        *(f'force_{joint}_N' for joint in machine.joints),
        *(f'{joint}_mm' for joint in machine.joints),
    ]
    heading += [f'{name}_{unit}' for name, unit in zip(machine.coordinates, units, strict=True)]
    columns = [response.time[:, np.newaxis], response.force, 1e3 * response.q, _POSE_SCALE * response.pose]
    if response.belts is not None:
        heading += ['psi_p_deg', 'psi_q_deg']
        columns.append(np.degrees(response.belts))
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(heading)
        writer.writerows([f'{value:.9g}' for value in row] for row in np.hstack(columns))


def draw(folder, name, machine, case, responses):
    """Draw joints and end point of the `responses`, by model, into folder/open_loop_<name>.png; Fig. 5.6-5.10."""
    figure = new_figure(11.0, 9.0)
    axes = figure.subplots(4, 2, sharex=True)
    for model, response in responses.items():
        style = {'color': '0.4', 'linestyle': '--', 'zorder': 3} if model == 'rigid' else {}
        time, pose = 1e3 * response.time, _POSE_SCALE * response.pose
        for row in range(4):
            axes[row, 0].plot(time, 1e3 * response.q[:, row], label=model, linewidth=1.2, **style)
            axes[row, 1].plot(time, pose[:, row], label=model, linewidth=1.2, **style)
    for row, (joint, coordinate) in enumerate(zip(machine.joints, machine.coordinates, strict=True)):
        low, high = axes[row, 0].get_ylim()
        for end in (machine.limits.lower[row], machine.limits.upper[row]):
            if low <= 1e3 * end <= high:
                axes[row, 0].axhline(1e3 * end, color='C3', linewidth=0.8)
                axes[row, 0].annotate('end of travel', (0.0, 1e3 * end), color='C3', fontsize='small', va='bottom')
        axes[row, 0].set(ylabel=f'{joint} [mm]')
        axes[row, 1].set(ylabel=f'{coordinate} [{"deg" if coordinate == "phi" else "mm"}]')
    for each in axes.flat:
        each.grid(alpha=0.3)
    for each in axes[-1]:
        each.set_xlabel('time [ms]')
    axes[0, 1].legend()
    figure.suptitle(f'case {case.title}: {case.rate:g} rad/s, {np.degrees(case.lag):g} deg')
    return save(figure, folder, f'open_loop_{name}')


def draw_differences(folder, name, machine, case, responses):
    """Draw joints of each model minus those of the rigid one into folder/open_loop_<name>_difference.png."""
    figure = new_figure(8.0, 8.0)
    panels = figure.subplots(4, 1, sharex=True)
    rigid = responses['rigid']
    for model, response in responses.items():
        if model == 'rigid':
            continue
        driven = response.time <= rigid.time[-1]
        apart = 1e3 * (response.q - _at(rigid, response.time))[driven]
        for axes, column in zip(panels, apart.T, strict=True):
            axes.plot(1e3 * response.time[driven], column, linewidth=1.2, label=model)
    for axes, joint in zip(panels, machine.joints, strict=True):
        axes.set(ylabel=f'{joint} [mm]')
        axes.grid(alpha=0.3)
    panels[0].set_title(f'case {case.title}: difference from the rigid model')
    panels[0].legend()
    panels[-1].set_xlabel('time [ms]')
    return save(figure, folder, f'open_loop_{name}_difference')


def draw_belts(folder, name, machine, case, responses):
    """Draw rotation of the platforms and shift of the end point into folder/open_loop_<name>_belts.png; Fig. 5.11."""
    figure = new_figure(8.0, 6.5)
    turns, shifts = figure.subplots(2, 1, sharex=True)
    for model, response in responses.items():
        time = 1e3 * response.time
        for column, platform in enumerate(('psi_p', 'psi_q')):
            turns.plot(time, np.degrees(response.belts[:, column]), linewidth=1.0, label=f'{platform}, {model}')
        for column, coordinate in enumerate(machine.coordinates[:3]):
            shifts.plot(time, 1e6 * response.belt_shift[:, column], linewidth=1.0, label=f'{coordinate}, {model}')
    turns.set(
        ylabel='rotation of the platforms [deg]', title=f'case {case.title}; forces end at {1e3 * case.duration:.1f} ms'
    )
    shifts.set(ylabel='shift of the end point [um]', xlabel='time [ms]')
    for axes in (turns, shifts):
        axes.axvline(1e3 * case.duration, color='0.6', linewidth=0.8)
        axes.grid(alpha=0.3)
        axes.legend(fontsize='small', ncols=2)
    return save(figure, folder, f'open_loop_{name}_belts')
