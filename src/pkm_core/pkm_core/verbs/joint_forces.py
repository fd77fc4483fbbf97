"""`pkm joint-forces`: forces and moments in every joint over a motion, for the sizing of bearings and links."""

from pathlib import Path

from pkm_core.machines import load_machine
from pkm_core.verbs.console import Output, table
from pkm_core.verbs.options import (
    JsonOption,
    MachineOption,
    MotionOption,
    OutOption,
    OverwriteOption,
    out_folder,
    write_figures,
)


def joint_forces(
    machine_name: MachineOption = 'four_dof',
    motion: MotionOption = '',
    out: OutOption = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Compute the force along, the force across and the moment in each guide, revolute joint and belt over a motion.

    Prints peak and root mean square. Newton-Euler equations of all bodies, without friction; for sizing.

    Example: `pkm joint-forces --out runs/joint_forces`

    Example: `pkm joint-forces --machine planar --motion planar_limits`
    """
    from pkm_core.design.joint_forces import joint_forces as solve
    from pkm_core.design.joint_forces import load_figures
    from pkm_core.motion.planning import default_motion, load_motion, plan
    from pkm_core.motion.trajectory import to_joints

    console, machine, out = Output(), load_machine(machine_name).drawing, out_folder(out)
    motion = motion or default_motion(machine)
    name, moved = Path(motion).stem, to_joints(machine, plan(machine, load_motion(motion, machine.configuration)))
    found = solve(machine, moved.position, moved.velocity, moved.acceleration)
    figures = load_figures(found)
    console.print(_table(f'{machine.name}, {name}: {len(moved)} samples', figures))
    console.plain(
        f'checks: Newton-Euler equations left over {found.residual[0]:.1e} N, {found.residual[1]:.1e} N m; thrusts '
        f'against the equations of motion {found.thrust_error:.1e} N; power of the reactions '
        f'{found.constraint_power:.1e} W; motors up to {found.drive_power:.2f} W, off the rate of energy '
        f'by {found.power_error:.1e} W'
    )
    checks = {
        'residual_N': found.residual[0],
        'residual_Nm': found.residual[1],
        'thrust_error_N': found.thrust_error,
        'reaction_power_W': found.constraint_power,
        'drive_power_W': found.drive_power,
        'energy_rate_error_W': found.power_error,
    }
    written = {'machine': machine.name, 'motion': name, 'samples': len(moved), 'joints': figures, 'checks': checks}
    write_figures(json_file, written)
    if out:
        from pkm_core.design.joint_force_figures import draw_joint_forces

        draw_joint_forces(out, found, machine.sample_time)
        console.plain(f'the figure is in {out}')


def _table(title, figures):
    headings = ['joint', 'along [N]: peak', 'rms', 'across [N]: peak', 'rms', 'moment [N m]: peak', 'rms']
    rows = []
    for name, row in figures.items():
        forces = (f'{row[key]:.2f}' for key in ('along_peak_N', 'along_rms_N', 'across_peak_N', 'across_rms_N'))
        rows.append((name, *forces, f'{row["moment_peak_Nm"]:.3f}', f'{row["moment_rms_Nm"]:.3f}'))
    return table(title, headings, rows, wide=False, no_wrap=True)
