"""One self-contained HTML page: tables as text, figures as embedded SVG."""

import base64
from html import escape

_STYLE = """
:root { color-scheme: light dark; --text: #222; --muted: #555; --line: #ddd; --rule: #888; --back: #fff;
  --link: #0b5cad; }
@media (prefers-color-scheme: dark) {
  :root { --text: #ddd; --muted: #a8a8a8; --line: #3a3a3a; --rule: #777; --back: #161616; --link: #7ab8ff; }
  figure img { filter: invert(0.91) hue-rotate(180deg); }
}
body { font: 15px/1.5 system-ui, sans-serif; color: var(--text); background: var(--back); max-width: 1150px;
       margin: 2em auto; padding: 0 1em; overflow-wrap: break-word; }
h1 { font-size: 1.6em; } h2 { font-size: 1.2em; margin-top: 2em; border-bottom: 1px solid var(--line); }
a { color: var(--link); } .lead { font-size: 1.1em; }
table { border-collapse: collapse; margin: 1em 0; font-size: 0.9em; display: block; overflow-x: auto;
        font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding: 0.3em 0; }
th, td { padding: 0.15em 0.7em; text-align: right; vertical-align: top; }
th { border-bottom: 1px solid var(--rule); font-weight: 600; }
td:first-child, th:first-child { text-align: left; white-space: nowrap; }
tr.group td { border-top: 1px solid var(--line); }
details table td { text-align: left; max-width: 40em; overflow-wrap: anywhere; }
summary { cursor: pointer; padding: 0.3em 0; }
figure { margin: 1em 0; overflow-x: auto; } figure img { max-width: 100%; }
figcaption, .remark { color: var(--muted); font-size: 0.9em; }
nav { display: flex; flex-wrap: wrap; gap: 0 1em; }
@media (max-width: 600px) {
  body { margin: 1em auto; padding: 0 0.7em; } h1 { font-size: 1.25em; }
  th, td { padding: 0.15em 0.4em; } figure img { max-width: none; width: 640px; }
}
"""


def page(title, sections, lead=()):
    """Return the HTML page of `sections`, a list of (heading, [fragments of HTML]), after the fragments of `lead`."""
    links = ''.join(f'<a href="#s{number}">{escape(heading)}</a>' for number, (heading, _) in enumerate(sections))
    body = ''.join(
        f'<h2 id="s{number}">{escape(heading)}</h2>\n{"".join(fragments)}'
        for number, (heading, fragments) in enumerate(sections)
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{escape(title)}</title><style>{_STYLE}</style></head>\n'
        f'<body><h1>{escape(title)}</h1>\n{"".join(lead)}<nav>{links}</nav>\n{body}</body></html>\n'
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


def lead_fragment(text):
    """Return a sentence in large type."""
    return f'<p class="lead">{escape(text)}</p>\n'


def folded_fragment(summary, fragments):
    """Return `fragments` folded under the line `summary`."""
    return f'<details><summary>{escape(summary)}</summary>{"".join(fragments)}</details>\n'


def remark_fragment(text):
    """Return a line in small type."""
    return f'<p class="remark">{escape(text)}</p>\n'
