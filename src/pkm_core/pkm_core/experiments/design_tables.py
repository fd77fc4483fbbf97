"""Tables 7.4 and 7.5: mass, effort and workspace of the XY stage and the planar manipulator."""

from pkm_core.control.model import load_model
from pkm_core.design.workspace import extremes
from pkm_core.machines import load_machine
from pkm_core.reporting.tables import Table


def effort_table(study):
    """
    Return Table 7.4 of the study of 'planar'.

    Moving mass is thrust over the identified gain, (7.34). Current and power are those of the worst joint with the
    robust controller in the counted cycles. Power is thrust times speed, without the heat in the coils.
    """
    columns = []
    for name in ('XY stage', 'robust'):
        outcomes = study.outcomes[name, 'nominal']
        machine = load_machine(outcomes[0].condition.machine)
        masses = [machine.thrust_per_volt / model.gain for model in load_model(machine).values()]
        current = machine.config.drive.amplifier_gain * max(each.peak_voltage for each in outcomes)
        columns.append([*masses, current, max(each.peak_power for each in outcomes)])
    forms = ('{:.2f}', '{:.2f}', '{:.1f}', '{:.1f}')
    names = ('moving mass, X axis or d1 [kg]', 'moving mass, Y axis or d3 [kg]', 'peak current [A]', 'motor power [W]')
    thesis = (('8.2', '0.97'), ('3.0', '0.97'), ('12', 'lost'), ('100', '20'))
    rows = [
        [name, theirs[0], form.format(stage), theirs[1], form.format(planar)]
        for name, theirs, form, stage, planar in zip(names, thesis, forms, *columns, strict=True)
    ]
    return Table('Table 7.4, moves of 10 mm: XY stage in 100 ms, planar machine in 80 ms', _HEADINGS, rows)


def size_table():
    """Return Table 7.5; the size of the frames is not modelled."""
    rows = [['mechanism size [mm]', '460 x 460', '', '210 x 270', '']]
    travels, reaches = [], []
    for name in ('xy_stage', 'planar'):
        machine = load_machine(name)
        travels.append(f'{1e3 * (machine.limits.upper - machine.limits.lower).min():.0f}')
        ends = [1e3 * (high.value - low.value) for low, high in extremes(machine).values()]
        reaches.append(' x '.join(f'{size:.1f}' for size in ends))
    rows.append(['actuator travel [mm]', '40', travels[0], '50', travels[1]])
    rows.append(['workspace [mm]', '40 x 40', reaches[0], '40 x 21', reaches[1]])
    return Table('Table 7.5', _HEADINGS, rows)


_HEADINGS = ['', 'XY stage, thesis', 'simulated', 'planar, thesis', 'simulated']
