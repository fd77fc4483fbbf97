"""Texts of the page as HTML: state of the cell, position of its tool, its nodes and its cycles; all names escaped."""

from html import escape
from itertools import islice
from math import degrees, isfinite

from pkm_nodes.page.cell import Status
from pkm_nodes.page.style import command_html

_GREY, _GREEN, _BLUE, _RED, _VIOLET = '#6c757d', '#2b8a3e', '#1864ab', '#c92a2a', '#6741d9'
_COLOURS = {
    Status.AWAY: _GREY,
    Status.STANDING: _GREEN,
    Status.RUNNING: _BLUE,
    Status.FAULT: _RED,
    Status.PLAYED: _VIOLET,
}
_ROWS = 12  # of the table of cycles
# [characters] of a text of the graph; a longer one would fill the panel
_TEXT = 400


def status_html(cell):
    """Return the state of the cell as a coloured line, and its figures as a table."""
    what = cell.status.value
    if cell.status == Status.AWAY:
        what = f'waiting for a cell in {cell.namespace}'
    elif cell.cycle:
        what = f'{what}, cycle {cell.cycle}'
    if cell.pace.paused:
        what += ', paused'
    if cell.player is not None:
        what += f', {1e3 * cell.player.time:.1f} ms{"" if cell.player.is_playing else ", paused"}'
    lines = [
        f'<div class="state" data-status="{cell.status.value}" style="background:{_COLOURS[cell.status]}">'
        f'{_text(what)}</div>'
    ]
    if cell.reason:
        lines.append(f'<div class="bad">{_text(cell.reason)}</div>')
    if cell.status == Status.AWAY:
        lines.append(_hint(cell))
    if cell.machine is not None:
        lines.append(_table(_figures(cell)))
    return f'<div class="pkm">{"".join(lines)}</div>'


def notice_html(cell):
    """Return the answer of the cell to the last button."""
    colour = 'good' if cell.notice.good else 'bad'
    return f'<div data-notice class="pkm {colour}">{_text(cell.notice.text) or "&nbsp;"}</div>'


def nodes_html(cell):
    """Return the table of nodes."""
    rows = [
        f'<tr><td class="{"good" if line.good else "bad"}">&#9679;</td><td>{_text(line.name)}</td>'
        f'<td style="text-align:right" class="{"muted" if line.good else "bad"}">{_text(line.text)}</td></tr>'
        for line in cell.nodes
    ]
    return f'<div class="pkm"><table data-nodes style="width:100%">{"".join(rows)}</table></div>'


def shown_html(cell):
    """Return which cycle the curves are of, or why there are none."""
    trace = cell.shown
    if cell.no_trace:
        return f'<div class="pkm bad" data-shown>no curves: {_text(cell.no_trace)}</div>'
    if trace is None:
        return '<div class="pkm muted" data-shown>curves appear after the first recorded cycle</div>'
    words = f'<b>cycle {trace.cycle}</b>: {_text(trace.motion)}, law {_text(trace.law)}'
    past = cell.history.get(trace.cycle)
    if past is not None and past.fault:
        words += f'<div class="bad">fault: {_text(past.fault)}</div>'
    if trace.is_cut:
        done, whole = (1e3 * cell.machine.sample_time * count for count in (len(trace.error), trace.samples))
        words += f'<div class="bad">curves until the stop, {done:.1f} of {whole:.1f} ms</div>'
    return f'<div class="pkm" data-shown>{words}</div>'


def learned_html(cell):
    """Return which motion the convergence is of."""
    if not cell.motion:
        return '<div class="pkm muted">no motion has run yet</div>'
    return f'<div class="pkm">{_text(cell.motion)}, law {_text(cell.law)}</div>'


def history_html(cell):
    """Return the table of the latest cycles."""
    rows = [
        f'<tr><td class="key">{past.cycle}</td><td class="{"bad" if past.fault else ""}">{_text(past.outcome)}</td>'
        f'<td class="muted" style="padding-left:8px">{_text(past.motion)}, {_text(past.law)}</td></tr>'
        for past in islice(cell.history, _ROWS)
    ]
    head = f'<div class="muted">{len(cell.history)} cycles; largest dynamic error of the worst axis</div>'
    return f'<div class="pkm" data-history>{head}<table style="width:100%">{"".join(rows)}</table></div>'


def _hint(cell):
    """Return what to do without a cell."""
    if cell.is_replayed:
        return (
            '<div>pkm bag-play publishes here. Another page shows a bag with pause and scrub:</div>'
            f'{command_html(".venv/bin/pkm page --bag BAG --port 8081")}'
        )
    domain = f'ROS_DOMAIN_ID={cell.domain} ' if cell.domain else ''
    namespace = '' if cell.namespace == '/pkm' else f' --ros-args -r __ns:={cell.namespace}'
    return (
        f'<div>Start a cell in ROS domain {cell.domain}, in the folder of the project:</div>'
        f'{command_html(f"{domain}bringup_scripts/ros2 run pkm_nodes cell{namespace}")}'
        f'<div>or a run of twelve learning cycles:</div>{command_html(f"{domain}bringup_scripts/run")}'
        f'<div>The page shows it as soon as it is up. A recorded run needs no cell:</div>'
        f'{command_html(".venv/bin/pkm page --bag runs/first --port 8081")}'
    )


def _figures(cell):
    rows = []
    if cell.status == Status.AWAY:
        rows.append(('last seen', _text(cell.machine.name)))
    if cell.motion:
        rows.append(('motion', _text(f'{cell.motion}, law {cell.law}')))
    last = max(cell.errors, default=0)
    if isfinite(cell.worst(last)):
        rows.append(('worst axis', f'<b data-worst>{1e6 * cell.worst(last):.2f}</b> um in cycle {last}'))
    if cell.best_cycle:
        rows.append(('at best', f'{1e6 * cell.worst(cell.best_cycle):.2f} um in cycle {cell.best_cycle}'))
    tool = cell.shown.tool if cell.shown is not None else None
    if tool is not None:
        largest = zip(cell.machine.coordinates, abs(tool.error).max(axis=0), strict=True)
        shown = ', '.join(f'{name} {1e6 * value:.1f}' for name, value in largest)
        rows.append(('tool by laser', f'<span data-tool>{shown}</span> um at most in cycle {tool.cycle}'))
    place = ' '.join(f'{1e3 * value:.3f}' for name, value in cell.pose.items() if name != 'phi')
    turn = f', {degrees(cell.pose["phi"]):.3f}&deg;' if 'phi' in cell.pose else ''
    rows.append(('tool', f'<span data-pose>{place}</span> mm{turn}'))
    if cell.player is not None and cell.player.error:
        shown = ', '.join(f'{name} {round(1e6 * value, 1) + 0.0:.1f}' for name, value in cell.player.error.items())
        rows.append(('error now', f'<span data-now>{shown}</span> um'))
    if cell.geometry:
        rows.append(('lengths', f'<span data-geometry>{_text(cell.geometry)}</span>'))
    if cell.ticks_per_second:
        factor = cell.ticks_per_second * cell.machine.sample_time
        rows.append(('speed', f'{cell.ticks_per_second:.0f} ticks/s, {factor:.2f} x real time'))
    if cell.nodes:
        bad = sum(not line.good for line in cell.nodes)
        of_them = f', <span class="bad">{bad} with a problem</span>' if bad else ''
        rows.append(('nodes', f'{len(cell.nodes)}{of_them}'))
    return rows


def _table(rows):
    cells = ''.join(f'<tr><td class="key">{name}</td><td>{value}</td></tr>' for name, value in rows)
    return f'<table>{cells}</table>'


def _text(text):
    """Return a text of the graph, escaped and of bounded length."""
    return escape(text if len(text) <= _TEXT else f'{text[:_TEXT]}...')
