"""`pkm report`: tables and figures of a run on one HTML page."""

from pathlib import Path
from typing import Annotated

import typer

from pkm_core.files import writable_file
from pkm_core.verbs.console import Output
from pkm_core.verbs.options import JsonOption, OverwriteOption, require_empty, write_figures


def report(
    folder: Annotated[Path, typer.Argument(help='Folder written by `pkm run`, or a folder of bags.')],
    compare: Annotated[Path | None, typer.Option(help='Second such folder, shown beside the first.')] = None,
    out: Annotated[Path | None, typer.Option(help='Folder for page and figures; default: FOLDER/report.')] = None,
    json_file: JsonOption = None,
    overwrite: OverwriteOption = False,
):
    """
    Write one HTML page of a run: tables beside those of the thesis, tracking, learning, spectra, drives, settling.

    Writes report.html, a self-contained file, and one PNG file per figure into --out.

    Example: `pkm report runs/first`

    Example: `pkm report runs/first --compare runs/second --out comparison`
    """
    from pkm_core.reporting.report import write_report
    from pkm_core.reporting.summary import cycles_table
    from pkm_core.reporting.tool import tool_table

    if out and not overwrite:
        require_empty(out)
    console, out = Output(), out or folder / 'report'
    if folder.is_dir():
        writable_file(out / 'report.html')  # reading the bags takes long
    with console.status('') as status:
        runs, figures = write_report([folder, compare] if compare else [folder], out, status.update)
    for run in runs:
        console.print(f'{run.name}:', markup=False)
        console.print(cycles_table(run.machine.name, run.records))
        if at_tool := tool_table(run.records):
            console.print(at_tool)
        for remark in run.remarks:
            console.plain(f'not used: {remark}')
    console.plain(str(out / 'report.html'))
    write_figures(json_file, figures)
