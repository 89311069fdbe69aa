"""A report as one HTML file that needs nothing else: tables and pictures within it, for screen and paper."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 "Helvetica Neue", Arial, "Liberation Sans", sans-serif; color: #26313b;
  background: #fff; max-width: 68rem; margin: 2.5rem auto; padding: 0 1.5rem; }
h1 { font-size: 1.75rem; font-weight: 600; margin: 0 0 .2rem; }
h2 { font-size: 1.2rem; font-weight: 600; margin: 2.4rem 0 .7rem; padding-bottom: .25rem; break-after: avoid;
  border-bottom: 1px solid #d5dbe0; }
p { margin: .5rem 0; max-width: 52rem; }
.lead { color: #5d6974; }
table { border-collapse: collapse; font-size: .86rem; margin: .8rem 0; break-inside: avoid; }
.long { break-inside: auto; }
th, td { padding: .28rem .7rem; text-align: right; vertical-align: top; border-bottom: 1px solid #e6eaee;
  font-variant-numeric: tabular-nums; }
th { font-weight: 600; border-bottom: 1.5px solid #8d98a3; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
.facts td { text-align: left; }
.facts td:first-child { color: #5d6974; white-space: nowrap; }
.words td:last-child, .words th:last-child { text-align: left; }
.wide { overflow-x: auto; }
tr { break-inside: avoid; }
figure { margin: 1rem 0 1.6rem; break-inside: avoid; }
figure img { max-width: 100%; height: auto; display: block; }
figcaption { font-size: .86rem; color: #5d6974; max-width: 52rem; margin-top: .3rem; }
@media print { body { margin: 0; max-width: none; font-size: 10.5pt; padding: 0; }
  .wide { overflow: visible; } table { font-size: 7.6pt; } th, td { padding: .15rem .4rem; } }
@page { size: A4; margin: 16mm 14mm; }
"""


def page(title: str, lead: str, parts: Sequence[str]) -> str:
    """Return a whole HTML document; `title` and `lead` are plain text, `parts` HTML."""
    body = "\n".join(parts)
    # The policy lets a browser load nothing from anywhere.
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>{escape(title)}</title>
<style>{_STYLE}</style>
</head>
<body>
<h1>{escape(title)}</h1>
<p class="lead">{escape(lead)}</p>
{body}
</body>
</html>
"""


def heading(words: str) -> str:
    """Return the heading of a section."""
    return f"<h2>{escape(words)}</h2>"


def paragraph(words: str) -> str:
    """Return a paragraph of plain text."""
    return f"<p>{escape(words)}</p>"


def facts(rows: Mapping[str, str]) -> str:
    """Return names and what they are."""
    lines = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in rows.items()
    )
    return f'<table class="facts">{lines}</table>'


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, words: bool = False) -> str:
    """Return a table of plain text; with `words` the last column is text to be read, not a number."""
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    lines = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    kind = ' class="words long"' if words else ' class="long"' if len(rows) > 30 else ""
    return (
        f'<div class="wide"><table{kind}><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div>'
    )


def picture(figure: Figure, caption: str) -> str:
    """Return a figure as a drawing within the page; the same figure gives the same text."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    drawing = io.BytesIO()
    with rc_context({"svg.hashsalt": "mbstudio", "svg.fonttype": "path"}):
        FigureCanvasSVG(figure).print_svg(drawing, metadata={"Date": None})
    # As an image of its own its names of parts do not meet those of other figures.
    data = base64.b64encode(drawing.getvalue()).decode("ascii")
    words = escape(caption, quote=True)
    return (
        f'<figure><img alt="{words}" src="data:image/svg+xml;base64,{data}">'
        f"<figcaption>{words}</figcaption></figure>"
    )
