"""Texts of the page as HTML: state of the cell, position of its tool, and the table of nodes."""

from html import escape
from math import degrees, isfinite

from pkm_nodes.page.cell import Status

_GREY, _GREEN, _BLUE, _RED = '#868e96', '#2b8a3e', '#1864ab', '#c92a2a'
_COLOURS = {Status.AWAY: _GREY, Status.STANDING: _GREEN, Status.RUNNING: _BLUE, Status.FAULT: _RED}
_BOX = 'font-size:12px;line-height:1.35;padding:2px 12px'


def status_html(cell):
    """Return the state of the cell as a coloured line, and its figures as a table."""
    what = cell.status.value
    if cell.status == Status.AWAY:
        what = f'waiting for a cell in {cell.namespace}'
    elif cell.cycle:
        what = f'{what}, cycle {cell.cycle}'
    lines = [
        f'<div data-status="{cell.status.value}" style="background:{_COLOURS[cell.status]};color:white;'
        f'font-weight:600;border-radius:4px;padding:3px 8px;margin-bottom:4px">{escape(what)}</div>'
    ]
    if cell.reason:
        lines.append(f'<div style="color:{_RED}">{escape(cell.reason)}</div>')
    if cell.machine is not None:
        lines += [_table(_figures(cell))]
    return f'<div style="{_BOX}">{"".join(lines)}</div>'


def notice_html(cell):
    """Return the answer of the cell to the last button."""
    colour = _GREEN if cell.notice.good else _RED
    text = escape(cell.notice.text) or '&nbsp;'
    return f'<div data-notice style="{_BOX};color:{colour};overflow-wrap:anywhere">{text}</div>'


def nodes_html(cell):
    """Return the table of nodes."""
    rows = [
        f'<tr><td style="color:{_GREEN if line.good else _RED}">&#9679;</td><td>{escape(line.name)}</td>'
        f'<td style="text-align:right;color:{_GREY if line.good else _RED}">{escape(line.text)}</td></tr>'
        for line in cell.nodes
    ]
    return f'<div style="{_BOX}"><table data-nodes style="width:100%;border-spacing:0">{"".join(rows)}</table></div>'


def _figures(cell):
    rows = []
    if cell.motion:
        rows.append(('motion', escape(f'{cell.motion}, law {cell.law}')))
    last = max(cell.errors, default=0)
    if isfinite(cell.worst(last)):
        rows.append(('worst axis', f'<b data-worst>{1e6 * cell.worst(last):.2f}</b> um in cycle {last}'))
    if cell.best_cycle:
        rows.append(('at best', f'{1e6 * cell.worst(cell.best_cycle):.2f} um in cycle {cell.best_cycle}'))
    if cell.tool is not None:
        largest = zip(cell.machine.coordinates, abs(cell.tool.error).max(axis=0), strict=True)
        shown = ', '.join(f'{name} {1e6 * value:.1f}' for name, value in largest)
        rows.append(('tool by laser', f'<span data-tool>{shown}</span> um at most in cycle {cell.tool.cycle}'))
    place = ' '.join(f'{1e3 * value:.3f}' for name, value in cell.pose.items() if name != 'phi')
    rows.append(('tool', f'<span data-pose>{place}</span> mm'))
    if 'phi' in cell.pose:
        rows.append(('phi', f'{degrees(cell.pose["phi"]):.3f}&deg;'))
    if cell.ticks_per_second:
        factor = cell.ticks_per_second * cell.machine.sample_time
        rows.append(('speed', f'{cell.ticks_per_second:.0f} ticks/s, {factor:.2f} x real time'))
    if cell.no_trace:
        rows.append(('no curves', escape(cell.no_trace)))
    return rows


def _table(rows):
    cells = ''.join(
        f'<tr><td style="color:{_GREY};white-space:nowrap;padding-right:8px">{name}</td><td>{value}</td></tr>'
        for name, value in rows
    )
    return f'<table style="font-variant-numeric:tabular-nums;border-spacing:0">{cells}</table>'
