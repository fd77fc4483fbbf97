"""`pkm report`: what the bags of a run have to tell, on one page."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pkm_core.verbs.options import JsonOption, write_json


def report(
    folder: Annotated[Path, typer.Argument(help='What `pkm run` has written, or a folder of bags.')],
    compare: Annotated[Path | None, typer.Option(help='Another such folder, to stand beside it.')] = None,
    out: Annotated[Path | None, typer.Option(help='Folder for page and figures; FOLDER/report by default.')] = None,
    json_file: JsonOption = None,
):
    """
    Make one HTML page of a run: tables beside the thesis's, tracking, learning, spectra, drives, settling, end point.

    Writes report.html, which needs nothing beside itself, and a PNG of every figure into --out.

    Example: `pkm report runs/first`

    Example: `pkm report runs/first --compare runs/second --out comparison`
    """
    from pkm_core.reporting.report import write_report
    from pkm_core.reporting.summary import cycles_table

    console, out = Console(), out or folder / 'report'
    with console.status('') as status:
        runs, figures = write_report([folder, compare] if compare else [folder], out, status.update)
    write_json(json_file, figures)
    for run in runs:
        console.print(f'{run.name}:', markup=False)
        console.print(cycles_table(run.machine.name, run.records))
        for remark in run.remarks:
            console.print(f'not used: {remark}', soft_wrap=True, markup=False)
    console.print(f'{out / "report.html"}', soft_wrap=True)
