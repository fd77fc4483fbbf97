"""Styles of the page: light and dark by preference of the browser, and the layout on a phone."""

from html import escape

# viser has a dark scheme by the query ?darkMode; this follows the preference of the browser, also when it changes.
# An event handler is the only script that HTML set by viser runs.
_FOLLOW_SCHEME = (
    "if(!window.pkmScheme){window.pkmScheme=matchMedia('(prefers-color-scheme: dark)');"
    'const follow=()=>{const at=new window.URL(window.location);'
    "if(at.searchParams.has('darkMode')===window.pkmScheme.matches)return;"
    "window.pkmScheme.matches?at.searchParams.set('darkMode',''):at.searchParams.delete('darkMode');"
    'window.location.replace(at)};window.pkmScheme.onchange=follow;follow()}'
)

# `width: 20em` is the bottom sheet of viser, shown below 36 em: there it leaves a third of a phone unused
_RULES = """
.pkm { font-size: 12px; line-height: 1.4; padding: 2px 12px; overflow-wrap: anywhere;
       --good: #2b8a3e; --bad: #c92a2a; --muted: #6c757d; --line: #dee2e6; }
[data-mantine-color-scheme=dark] .pkm { --good: #69db7c; --bad: #ff8787; --muted: #a1a5ab; --line: #424242; }
.pkm table { border-spacing: 0; font-variant-numeric: tabular-nums; }
.pkm td { padding: 0; vertical-align: top; } .pkm td.key { color: var(--muted); white-space: nowrap;
  padding-right: 8px; }
.pkm .good { color: var(--good); } .pkm .bad { color: var(--bad); } .pkm .muted { color: var(--muted); }
.pkm .state { color: white; font-weight: 600; border-radius: 4px; padding: 3px 8px; margin-bottom: 4px; }
.pkm pre { display: flex; gap: 6px; align-items: center; margin: 4px 0 8px; }
.pkm code { flex: 1; user-select: all; white-space: pre-wrap; border: 1px solid var(--line); border-radius: 4px;
  padding: 4px 6px; }
.pkm pre button { font: inherit; cursor: pointer; padding: 3px 8px; border: 1px solid var(--line); border-radius: 4px;
  background: none; color: inherit; }
@media (max-width: 36em) {
  [style*="width: 20em"] { width: 100vw !important; }
}
"""
HEAD = f'<style>{_RULES}</style><img src="data:," alt="" style="display:none" onerror="{escape(_FOLLOW_SCHEME)}">'


def command_html(command):
    """Return a shell command as HTML: a click on its text selects it, a button copies it."""
    copy = "navigator.clipboard.writeText(this.previousElementSibling.textContent);this.textContent='copied'"
    return f'<pre><code data-command>{escape(command)}</code><button onclick="{copy}">copy</button></pre>'
