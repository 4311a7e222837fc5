"""HTML of a report: one file that needs no other."""

import html

_CSS = """
:root { color-scheme: light dark; --ink: #1c1c1c; --paper: #fafafa; --faint: #666;
  --line: #d8d8d8; --card: #fff; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8e8e8; --paper: #17191c; --faint: #a0a0a0;
  --line: #3a3d42; --card: #202327; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 68rem; padding: 1.5rem; background: var(--paper);
  color: var(--ink); font: 16px/1.5 system-ui, "Segoe UI", Roboto, sans-serif; }
h1 { font-size: 1.6rem; margin: 0 0 .2rem; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem; border-bottom: 1px solid var(--line); }
p, figcaption { max-width: 46rem; }
.faint, figcaption { color: var(--faint); font-size: .9rem; }
.facts { display: grid; grid-template-columns: repeat(auto-fit, minmax(9.5rem, 1fr)); gap: .7rem;
  margin: 1.2rem 0; padding: 0; list-style: none; }
.facts li { background: var(--card); border: 1px solid var(--line); border-radius: 6px;
  padding: .6rem .8rem; }
.facts b { display: block; font-size: 1.35rem; font-variant-numeric: tabular-nums; }
.note { border-left: 4px solid #b8500c; background: var(--card); padding: .6rem 1rem; }
figure { margin: .8rem 0 1.2rem; }
/* The pictures are drawn for white paper, in the dark too. */
figure > div { background: #fff; border: 1px solid var(--line); border-radius: 6px;
  padding: .5rem; }
figure svg { display: block; width: 100%; height: auto; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .9rem; }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid var(--line);
  white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
tr.best { font-weight: 600; }
tr.other { color: var(--faint); font-style: italic; }
@media print { body { max-width: none; } figure, table { break-inside: avoid; } }
"""


def escaped(text) -> str:
    """Returns text that a page shows as it is."""
    return html.escape(str(text))


def page(title: str, body: list) -> str:
    """Returns a whole page of pieces of HTML."""
    return "\n".join(
        [
            "<!doctype html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escaped(title)}</title>",
            f"<style>{_CSS}</style>",
            "</head>",
            "<body>",
            *body,
            "</body>",
            "</html>",
            "",
        ]
    )


def heading(text: str) -> str:
    """Returns the heading of a section."""
    return f"<h2>{escaped(text)}</h2>"


def figure(svg: str, caption: str) -> str:
    """Returns a picture with what it shows below."""
    return f"<figure><div>{svg}</div><figcaption>{escaped(caption)}</figcaption></figure>"


def note(text: str) -> str:
    """Returns a remark that must not be overlooked."""
    return f'<p class="note">{escaped(text)}</p>'


def facts(pairs) -> str:
    """Returns a row of large numbers; pairs: of what it is and the number."""
    items = (f"<li>{escaped(name)}<b>{escaped(value)}</b></li>" for name, value in pairs)
    return f'<ul class="facts">{"".join(items)}</ul>'


def table(columns, rows, caption: str) -> str:
    """Returns a table.

    Args:
        columns: names.
        rows: pairs of a class of CSS, or "", and the cells.
        caption: what it shows.
    """
    head = "".join(f'<th scope="col">{escaped(name)}</th>' for name in columns)
    body = "".join(
        f'<tr class="{kind}">' + "".join(f"<td>{escaped(cell)}</td>" for cell in cells) + "</tr>"
        for kind, cells in rows
    )
    return (
        f'<div class="scroll"><table aria-label="{escaped(caption)}"><thead><tr>{head}</tr>'
        f'</thead><tbody>{body}</tbody></table></div><p class="faint">{escaped(caption)}</p>'
    )
