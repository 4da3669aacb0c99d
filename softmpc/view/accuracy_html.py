"""Pieces of a page in HTML: text escaped, tables, pictures inside the page, its looks."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

from softmpc.view.style import styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["details", "element", "items", "page", "picture", "table", "terms"]

Table = Sequence[Sequence[str]]  # the head first
LOOKS = """
:root { color-scheme: light; }
body { margin: 0 auto; padding: 1.5rem 1rem 4rem; max-width: 68rem; color: #1a1a1a;
  background: #fff; font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans",
  sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.3rem; margin: 2.4rem 0 .6rem; border-bottom: 2px solid #1a1a1a; }
h3 { font-size: 1.05rem; margin: 1.6rem 0 .4rem; }
p, ul, dl { margin: .5rem 0; max-width: 46rem; }
li { margin: .25rem 0; }
dt { font-weight: 600; margin-top: .5rem; }
dd { margin: 0 0 0 1.2rem; }
.lead { color: #444; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; }
th, td { padding: .22rem .7rem .22rem 0; text-align: right; vertical-align: top;
  border-bottom: 1px solid #ccc; }
th { border-bottom: 2px solid #1a1a1a; font-weight: 600; vertical-align: bottom; }
td { white-space: nowrap; }
.left { text-align: left; white-space: normal; min-width: 7rem; }
figure { margin: 1.2rem 0; }
img { max-width: 100%; height: auto; }
figcaption { font-size: .9rem; color: #333; max-width: 46rem; }
pre { overflow-x: auto; padding: .6rem .8rem; border: 1px solid #ccc; font-size: .85rem; }
summary { cursor: pointer; font-weight: 600; margin: .8rem 0 .4rem; }
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; }
  h2, h3 { break-after: avoid; }
  figure, tr { break-inside: avoid; }
  .wide { overflow: visible; }
  table { font-size: 7.5pt; }
}
""".strip()


def page(title: str, parts: Sequence[str]) -> str:
    """A whole page of parts that are HTML already."""
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            element("title", title),
            f"<style>\n{LOOKS}\n</style>",
            "</head>",
            "<body>",
            *parts,
            "</body>",
            "</html>",
            "",
        ]
    )


def element(name: str, text: str, kind: str = "") -> str:
    """An element with text in it, which is escaped."""
    own = f' class="{kind}"' if kind else ""
    return f"<{name}{own}>{escape(text)}</{name}>"


def items(texts: Sequence[str]) -> str:
    """A list; empty for nothing."""
    if not texts:
        return ""
    return "\n".join(["<ul>", *(element("li", text) for text in texts), "</ul>"])


def terms(meanings: Sequence[tuple[str, str]]) -> str:
    """A list of words and what they mean."""
    pairs = [element("dt", word) + element("dd", text) for word, text in meanings]
    return "\n".join(["<dl>", *pairs, "</dl>"])


def table(rows: Table, texts: int) -> str:
    """So many first columns to the left, the others to the right; empty without a body."""
    if len(rows) < 2:
        return ""

    def line(row: Sequence[str], cell: str) -> str:
        cells = [element(cell, text, "left" if i < texts else "") for i, text in enumerate(row)]
        return f"<tr>{''.join(cells)}</tr>"

    head, *body = rows
    lines = [line(row, "td") for row in body]
    return "\n".join(
        ['<div class="wide"><table>', f"<thead>{line(head, 'th')}</thead>", "<tbody>", *lines,
         "</tbody>", "</table></div>"]
    )  # fmt: skip


def details(summary: str, inside: str) -> str:
    """What is seen when it is asked for; `inside` is HTML already."""
    return f"<details>\n{element('summary', summary)}\n{inside}\n</details>"


@styled
def picture(made: Figure, about: str) -> str:
    """A picture, as lines that stay sharp on paper; below it what is to be seen, if told."""
    import matplotlib as mpl

    file = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "softmpc", "svg.fonttype": "path"}):
        made.savefig(file, format="svg", metadata={"Date": None})
    data = b64encode(file.getvalue()).decode()
    name = escape(made.get_suptitle(), quote=True)
    image = f'<img alt="{name}" src="data:image/svg+xml;base64,{data}">'
    caption = element("figcaption", about) if about else ""
    return f"<figure>\n{image}\n{caption}\n</figure>"
