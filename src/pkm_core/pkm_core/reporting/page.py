"""One self-contained HTML page: tables as text, figures as embedded SVG."""

import base64
from html import escape

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 1150px; margin: 2em auto;
       padding: 0 1em; }
h1 { font-size: 1.6em; } h2 { font-size: 1.2em; margin-top: 2em; border-bottom: 1px solid #ddd; }
table { border-collapse: collapse; margin: 1em 0; font-size: 0.9em; display: block; overflow-x: auto; }
caption { text-align: left; font-weight: 600; padding: 0.3em 0; }
th, td { padding: 0.15em 0.7em; text-align: right; vertical-align: top; } td { overflow-wrap: anywhere; }
th { border-bottom: 1px solid #888; font-weight: 600; }
td:first-child, th:first-child { text-align: left; white-space: nowrap; }
tr.group td { border-top: 1px solid #ddd; }
figure { margin: 1em 0; } figure img { max-width: 100%; } figcaption, .remark { color: #555; font-size: 0.9em; }
nav a { margin-right: 1em; }
"""


def page(title, sections):
    """Return the HTML page of `sections`, a list of (heading, [fragments of HTML])."""
    links = ''.join(f'<a href="#s{number}">{escape(heading)}</a>' for number, (heading, _) in enumerate(sections))
    body = ''.join(
        f'<h2 id="s{number}">{escape(heading)}</h2>\n{"".join(fragments)}'
        for number, (heading, fragments) in enumerate(sections)
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{escape(title)}</title><style>{_STYLE}</style></head>\n'
        f'<body><h1>{escape(title)}</h1>\n<nav>{links}</nav>\n{body}</body></html>\n'
    )


def table_fragment(table):
    """Return a `Table` as HTML; a row with text in its first cell begins a group."""
    head = ''.join(f'<th>{escape(heading)}</th>' for heading in table.headings)
    rows = ''.join(
        f'<tr{" class=group" if row[0] else ""}>' + ''.join(f'<td>{escape(cell)}</td>' for cell in row) + '</tr>\n'
        for row in table.rows
    )
    caption = f'<caption>{escape(table.title)}</caption>' if table.title else ''
    return f'<table>{caption}<thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table>\n'


def figure_fragment(svg, caption):
    """Return the SVG bytes `svg` as a figure of the page; an image element keeps its ids and styles separate."""
    data = base64.b64encode(svg).decode()
    text = escape(caption)
    return (
        f'<figure><img alt="{text}" src="data:image/svg+xml;base64,{data}"><figcaption>{text}</figcaption></figure>\n'
    )


def remark_fragment(text):
    """Return a line in small type."""
    return f'<p class="remark">{escape(text)}</p>\n'
