"""The report of a run: tables and figures on one page, and the figures as PNG files."""

from io import BytesIO

from pkm_core.files import refused_if_unwritable, writable_folder
from pkm_core.recording.provenance import git_revision
from pkm_core.reporting import figures
from pkm_core.reporting.facts import facts_table, parameters_table
from pkm_core.reporting.histories import ARM
from pkm_core.reporting.outcome import outcome_sentence, outcome_table
from pkm_core.reporting.page import (
    figure_fragment,
    folded_fragment,
    lead_fragment,
    page,
    remark_fragment,
    table_fragment,
)
from pkm_core.reporting.runs import read_runs
from pkm_core.reporting.summary import cycle_figures, messages
from pkm_core.reporting.tables import messages_table, moves_table, run_figures, space_tables
from pkm_core.reporting.tool import path_table, tool_figures

_ABOUT = (
    'Errors are reference minus measured. Each value is that of the worst move of a cycle. The dynamic error is the '
    'largest from the start of a move to the end of its profile; the settling time starts at that end. '
    'The steady-state error is the mean over the last 10 ms of a rest; at the end point the thesis calls it accuracy. '
    f'phi counts as displacement on a radius of {1e3 * ARM:g} mm.'
)
_FIGURES = {  # by heading
    'Error over cycles': [figures.error_over_cycles],
    'Tracking': [figures.tracking, figures.pose_tracking, figures.error],
    'Spectrum of the error': [figures.spectrum],
    'Drive': [figures.voltage],
    'Settling': [figures.settling, figures.end_point],
}


def write_report(folders, out, on_step=lambda text: None):
    """
    Write report.html and a PNG of every figure of the runs in `folders` into the folder `out`.

    Parameters
    ----------
    folders : list of Path
        One run, or two for a comparison.
    out : Path
        Created if missing; an older report is overwritten.
    on_step : callable
        Called with the name of each step when it begins.

    Returns
    -------
    runs : list of Run
    figures : dict
        All numbers of the page.

    Raises
    ------
    PkmError
        If a folder has no run, or `out` cannot be written.

    """
    runs = read_runs(folders, on_step)
    out = writable_folder(out)
    numbers = [run_figures(run) for run in runs]
    counts = [messages(run.records) for run in runs]
    sections = [
        ('All figures', [table_fragment(table) for table in _tables(runs, numbers)] + [remark_fragment(_ABOUT)]),
    ]
    with refused_if_unwritable(out):
        for heading, drawings in _FIGURES.items():
            on_step(f'drawing: {heading.lower()}')
            sections.append((heading, [_draw(drawing, runs, out) for drawing in drawings]))
        sections[-1][1].extend(table_fragment(moves_table(run)) for run in runs)
        sections.append(('Settings and messages', _settings(runs, counts)))
        title = ' and '.join(f'{run.machine.name}, {run.records[-1].motion}: {run.name}' for run in runs)
        lead = [lead_fragment(outcome_sentence(run, number)) for run, number in zip(runs, numbers, strict=True)]
        lead += [table_fragment(outcome_table(runs, numbers)), *_unused(runs)]
        (out / 'report.html').write_text(page(title, sections, lead), encoding='utf-8')
    return runs, {
        'runs': [
            {
                'folder': str(folder),
                **run.facts,
                'cycles': [
                    {'cycle': record.cycle, 'axes': cycle_figures(record), 'tool': tool_figures(record)}
                    for record in run.records
                ],
                **number,
                'messages': count,
                'remarks': run.remarks,
            }
            for folder, run, number, count in zip(folders, runs, numbers, counts, strict=True)
        ]
    }


def _tables(runs, numbers):
    path = path_table(runs)
    return [*space_tables(runs, numbers), *([path] if path else [])]


def _unused(runs):
    """Return the list of unused bags."""
    return [remark_fragment(f'{run.name}: not used: {remark}') for run in runs for remark in run.remarks]


def _settings(runs, counts):
    """Return the settings of the runs; the parameters of the nodes and the account of the messages are folded."""
    fragments = [table_fragment(facts_table(runs))]
    for run, count in zip(runs, counts, strict=True):
        parameters = parameters_table(run)
        if parameters is not None:
            fragments.append(folded_fragment(parameters.title, [table_fragment(parameters)]))
        messages_of_run = messages_table(run, count)
        fragments.append(folded_fragment(messages_of_run.title, [table_fragment(messages_of_run)]))
    return [*fragments, remark_fragment(f'written by pkm report, revision {git_revision()}')]


def _draw(drawing, runs, out):
    """Draw one figure, save it as PNG, and return it as a fragment of the page."""
    from matplotlib import rc_context

    figure, stream = drawing(runs), BytesIO()
    figure.savefig(out / f'{drawing.__name__}.png', dpi=110)
    figure.set_layout_engine('none')  # the layout is final; computing it again would take as long as the drawing
    with rc_context({'svg.fonttype': 'none', 'svg.hashsalt': 'pkm'}):  # text as text, and reproducible ids
        figure.savefig(stream, format='svg', metadata={'Date': None})
    return figure_fragment(stream.getvalue(), drawing.__doc__)
