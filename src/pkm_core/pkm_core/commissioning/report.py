"""Commissioning report: tables for the console and one self-contained HTML page."""

import base64
import html
from io import BytesIO

import numpy as np

from pkm_core.commissioning.measured import measured_loop
from pkm_core.control.margin_plots import draw_nyquist
from pkm_core.control.margins import unit_circle
from pkm_core.control.systems import plant_system
from pkm_core.design.units import units
from pkm_core.plotting import new_figure
from pkm_core.recording.provenance import git_revision
from pkm_core.reporting.page import figure_fragment, page, remark_fragment, table_fragment
from pkm_core.reporting.tables import Table


def verdict(outcome):
    """Return the outcome as a list of sentences."""
    if outcome.accepted:
        texts = ['The new gains have passed the acceptance move and are kept.']
        if outcome.not_calibrated:
            texts.append(f'The former lengths stay in use: {outcome.not_calibrated}')
        elif outcome.calibrated:
            texts.append(f'The calibrated lengths are in use: misfit {outcome.calibrated.misfit:.2f} of the noise.')
        return [*texts, f'The motion was not learned: {outcome.not_learned}'] if outcome.not_learned else texts
    return ['The new gains are not kept; model and gains are restored. Reasons:', *outcome.reasons]


def error_table(machine, outcome):
    """Return the table of largest dynamic errors [um] and settling times [ms] of the moves, one row per axis."""
    moves = {
        'as found': outcome.as_found[:1],
        'acceptance': outcome.tuned[:1],
        'restored gains': outcome.restored[:1],
        f'learned, cycle {len(outcome.learned)}': outcome.learned[-1:],
    }
    moves = {name: cycles[0] for name, cycles in moves.items() if cycles}
    rows = [
        [joint, *(f'{1e6 * metrics[axis].max_dynamic_error:.1f}' for metrics in moves.values()),
         *(_or_never(1e3 * metrics[axis].settling_time_5um) for metrics in moves.values())]
        for axis, joint in enumerate(machine.joints)
    ]  # fmt: skip
    headings = [*(f'{name} [um]' for name in moves), *(f'{name}: to 5 um [ms]' for name in moves)]
    return Table('Largest dynamic error and settling time of the motion', ['axis', *headings], rows)


def end_point_table(machine, outcome):
    """Return the table of the end point at rest by laser before and after the calibration, one row per coordinate."""
    rows = []
    if outcome.calibrated:
        found = outcome.calibrated.verification
        columns = (found.before, found.after, found.before_largest, found.after_largest, found.noise)
        for i, (name, (factor, unit)) in enumerate(zip(found.coordinates, units(machine), strict=True)):
            rows.append([f'{name} [{unit}]', *(f'{factor * column[i]:.3f}' for column in columns)])
    title = 'End point at rest by laser at poses not used, less the mean'
    if outcome.calibrated and outcome.calibrated.machine_file is None:
        title += '; not taken up'
    headings = ['', 'before, rms', 'calibrated, rms', 'before, largest', 'calibrated, largest', 'noise']
    return Table(title, headings, rows)


def model_table(outcome):
    """Return the table of the models, previous and identified."""
    rows = []
    for joint, model in outcome.models.items():
        for name, each in (('previous', outcome.previous_models[joint]), ('identified', model)):
            modes = '  '.join(f'{mode.resonance:.1f} / {mode.antiresonance:.1f}' for mode in each.modes)
            rows.append([joint if name == 'previous' else '', name, f'{each.gain:.4f}', f'{each.viscosity:.2f}', modes])
    headings = ['axis', '', 'K [m/s²/V]', 'a [1/s]', 'resonance / anti-resonance [Hz]']
    return Table('Models K/(s (s + a)) H(s)', headings, rows)


def candidate_table(outcome):
    """Return the table of candidates with their costs; one per axis is recommended."""
    rows = []
    for joint, candidates in outcome.candidates.items():
        for number, each in enumerate(candidates):
            cells = (f'{m.gain_margin:.1f} / {m.phase_margin:.0f} / {m.peak_sensitivity:.2f}'
                     for m in (each.margins, each.worst))  # fmt: skip
            remark = 'recommended' if each.recommended else ''
            remark = '; '.join(filter(None, [remark, each.beyond and f'beyond: {", ".join(each.beyond)}']))
            rows.append(['' if number else joint, each.name, f'{each.objective:.3f}', *cells, remark])
    headings = ['axis', 'candidate', 'cost J', 'GM dB / PM deg / Smax', 'worst perturbed', '']
    return Table('Candidates on the identified models', headings, rows)


def measured_table(outcome):
    """Return the table of margins of the recommended gains on the measured responses."""
    rows = []
    for joint, found in outcome.measured.items():
        for number, response in enumerate(outcome.identified.responses[joint]):
            margins = found[response.name]
            place, first = f'{1e3 * response.position:.1f}', joint if number == 0 else ''
            figures = (margins.gain_margin, margins.phase_margin, margins.peak_sensitivity, margins.crossover)
            rows.append([first, place, *(f'{value:.2f}' for value in figures)])
    headings = ['axis', 'measured at [mm]', 'GM [dB]', 'PM [deg]', 'Smax', '|L| = 1 [Hz]']
    return Table('Recommended gains on the measured responses', headings, rows)


def write_page(path, machine, outcome, facts):
    """
    Write the report of a `Commissioning` to `path`.

    `facts` is a dict of options and versions for the head of the page. Plots of the identification are read from the
    folder of its model file.
    """
    table = Table('', ['', ''], [[name, str(value)] for name, value in facts.items()])
    revision = remark_fragment(f'written by pkm commission, revision {git_revision()}')
    sections = [
        ('Outcome', [*(f'<p>{html.escape(text)}</p>' for text in verdict(outcome)),
                     table_fragment(error_table(machine, outcome)), *_end_point(machine, outcome),
                     table_fragment(table), revision]),
        ('Identification', [table_fragment(model_table(outcome)), *map(remark_fragment, outcome.identified.warnings)]),
        ('Gains', [table_fragment(candidate_table(outcome)), table_fragment(measured_table(outcome))]),
    ]  # fmt: skip
    if outcome.measured:
        sections[-1][1].append(_svg(_loops(machine, outcome), _LOOPS))
    if outcome.learned:
        sections.append(
            ('Learning', [_svg(_learning(machine, outcome), 'Largest dynamic error of each axis over cycles.')])
        )
    pictures = sorted(outcome.identified.model_file.parent.glob('*.png'))
    sections.append(('Measurements', [_png(picture) for picture in pictures]))
    path.write_text(page(f'{machine.name}: commissioning', sections), encoding='utf-8')


def _end_point(machine, outcome):
    return [table_fragment(end_point_table(machine, outcome))] if outcome.calibrated else []


_LOOPS = (
    'L near -1 with the recommended gains: with the identified model (line), and with the responses measured at each '
    'position of the motor pair (dots).'
)


def _loops(machine, outcome):
    figure = new_figure(4.2 * len(outcome.measured), 4.2)
    for axes, joint in zip(np.atleast_1d(figure.subplots(1, len(outcome.measured))), outcome.measured, strict=True):
        gains = next(each.gains for each in outcome.candidates[joint] if each.recommended)
        model, responses = outcome.models[joint], outcome.identified.responses[joint]
        frequency = np.geomspace(20.0, 0.499 / machine.sample_time, 2000)
        z = unit_circle(frequency, machine.sample_time)
        draw_nyquist(axes, gains.response(z, machine.sample_time) * plant_system(model, machine.sample_time)(z))
        for response in responses:
            measured, loop = measured_loop(gains, model, response, machine.sample_time)
            loop = loop[measured >= response.frequency[0]]
            axes.plot(loop.real, loop.imag, '.', color='k', markersize=2)
        axes.set_title(joint)
    return figure


def _learning(machine, outcome):
    figure = new_figure(7.0, 4.0)
    axes = figure.subplots()
    errors = 1e6 * np.array([[axis.max_dynamic_error for axis in cycle] for cycle in outcome.learned])
    axes.semilogy(np.arange(1, len(errors) + 1), errors, '.-', label=machine.joints)
    axes.set(xlabel='cycle', ylabel='largest dynamic error [um]')
    axes.grid(which='both', alpha=0.3)
    axes.legend()
    return figure


def _svg(figure, caption):
    stream = BytesIO()
    figure.savefig(stream, format='svg', metadata={'Date': None})
    return figure_fragment(stream.getvalue(), caption)


def _png(path):
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<figure><img alt="{path.stem}" src="data:image/png;base64,{data}"></figure>\n'


def _or_never(value):
    return 'never' if np.isnan(value) else f'{value:.1f}'
