"""A report as one file of HTML: no script, and nothing that is loaded from outside.

The page is written so that it is XML as well, which any parser of either kind reads.  What the caller passes is text,
never markup: `<` in a label stays a `<`.
"""

from __future__ import annotations

import base64
import html
import re
from dataclasses import dataclass
from typing import Final

from lithoform.errors import LithoformError

__all__ = ["Block", "Bullets", "Cell", "Page", "Paragraph", "Picture", "Table"]

TONES: Final = ("plain", "same", "open", "slight", "strong")
"""How a cell is coloured: not at all; as an agreement; as an open question; as a slight and as a strong difference."""

# Of Unicode, XML 1.0 takes all but these.
_NOT_XML: Final = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

_STYLE: Final = """
:root { color-scheme: light dark; --ink: #2b2a28; --paper: #ffffff; --soft: #6d6a64; --line: #d8d4cc; --band: #f6f4f0;
  --same: #d9efe4; --open: #ecebe8; --slight: #fbefcf; --strong: #f9d9c8; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e3dd; --paper: #1b1a19; --soft: #a7a39b; --line: #45423d; --band: #262422;
    --same: #1d4433; --open: #3a3835; --slight: #54430f; --strong: #62311a; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 80rem; padding: 1.5rem 1rem 4rem; background: var(--paper); color: var(--ink);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 0.75rem; overflow-wrap: anywhere; }
h2 { font-size: 1.25rem; margin: 2.25rem 0 0.5rem; padding-top: 0.75rem; border-top: 1px solid var(--line); }
p, li { max-width: 62rem; overflow-wrap: anywhere; }
ul { padding-left: 1.25rem; }
li { margin: 0.2rem 0; }
.wide { overflow-x: auto; margin: 0.75rem 0 1.25rem; }
table { border-collapse: collapse; font-size: 0.8125rem; font-variant-numeric: tabular-nums; }
caption { caption-side: top; text-align: left; color: var(--soft); padding: 0 0 0.4rem; overflow-wrap: anywhere; }
th, td { padding: 0.25rem 0.4rem; text-align: right; vertical-align: top; }
th { border-bottom: 1px solid var(--ink); font-weight: 600; vertical-align: bottom; }
td { border-bottom: 1px solid var(--line); }
.text { text-align: left; max-width: 11rem; overflow-wrap: break-word; }
td:not(.text) { white-space: nowrap; }
.same, .open, .slight, .strong { min-width: 7.5rem; }
td.long { max-width: none; min-width: 16rem; white-space: normal; }
tr.first td { border-top: 2px solid var(--soft); }
.same { background: var(--same); } .open { background: var(--open); }
.slight { background: var(--slight); } .strong { background: var(--strong); }
figure { margin: 1rem 0 1.5rem; }
figure img { display: block; max-width: 100%; height: auto; background: #ffffff; border: 1px solid var(--line); }
figcaption { color: var(--soft); font-size: 0.9rem; margin-top: 0.4rem; max-width: 62rem; }
@media print {
  :root { color-scheme: light; --ink: #000000; --paper: #ffffff; --soft: #444444; --line: #bbbbbb; --band: #f6f4f0;
    --same: #d9efe4; --open: #ecebe8; --slight: #fbefcf; --strong: #f9d9c8; }
  @page { size: A4 landscape; margin: 12mm; }
  body { max-width: none; padding: 0; font-size: 10pt; print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  table { font-size: 7.5pt; } th, td { padding: 0.1rem 0.35rem; }
  .wide { overflow: visible; } td.long { min-width: 9rem; }
  thead { display: table-header-group; }
  tr, figure { break-inside: avoid; } h2 { break-after: avoid; }
  figure img { max-height: 160mm; width: auto !important; border: none; } }
"""


@dataclass(frozen=True)
class Cell:
    """A cell of a table that is coloured.

    Attributes
    ----------
    text : str
    tone : str
        One of `TONES`.
    """

    text: str
    tone: str = "plain"


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of text."""

    text: str


@dataclass(frozen=True)
class Bullets:
    """A list of lines."""

    lines: tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes
    ----------
    head : tuple of str
    rows : tuple of tuples of str or Cell
        Each as long as the head.
    caption : str
        What the columns mean; empty for none.
    texts : tuple of int
        Columns of words, set from the left; all others are numbers, set from the right.
    long : tuple of int
        Columns of words that are broken into lines.
    groups : tuple of int
        Rows above which a line is drawn.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str | Cell, ...], ...]
    caption: str = ""
    texts: tuple[int, ...] = (0,)
    long: tuple[int, ...] = ()
    groups: tuple[int, ...] = ()


@dataclass(frozen=True)
class Picture:
    """A picture that the page holds itself.

    Attributes
    ----------
    png : bytes
        PNG file.
    alternative : str
        What it shows, for those who cannot see it.
    caption : str
    width : float
        Width on the page [mm].
    """

    png: bytes
    alternative: str
    caption: str = ""
    width: float = 240.0


Block = Paragraph | Bullets | Table | Picture


class Page:
    """A page that grows from top to bottom.

    Parameters
    ----------
    title : str
    """

    def __init__(self, title: str) -> None:
        self.title = title
        self._parts: list[str] = []

    def add(self, *blocks: Block) -> None:
        """Put blocks at the end.

        Raises
        ------
        LithoformError
            If a row of a table is longer or shorter than its head, or a tone is unknown.
        """
        self._parts += [_written(block) for block in blocks]

    def section(self, title: str, *blocks: Block) -> None:
        """Begin a section; errors as `add`."""
        self._parts.append(f"<h2>{_escaped(title)}</h2>")
        self.add(*blocks)

    def to_bytes(self) -> bytes:
        """The page in UTF-8; the same blocks give the same bytes."""
        title = _escaped(self.title)
        # The policy makes a browser refuse whatever would be loaded from elsewhere.
        policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
        lines = [
            "<!DOCTYPE html>",
            '<html lang="en" xmlns="http://www.w3.org/1999/xhtml">',
            "<head>",
            '<meta charset="utf-8" />',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}" />',
            '<meta name="viewport" content="width=device-width, initial-scale=1" />',
            f"<title>{title}</title>",
            f"<style>{_STYLE}</style>",
            "</head>",
            "<body>",
            f"<h1>{title}</h1>",
            *self._parts,
            "</body>",
            "</html>",
        ]
        return ("\n".join(lines) + "\n").encode()


def _written(block: Block) -> str:
    if isinstance(block, Paragraph):
        return f"<p>{_escaped(block.text)}</p>"
    if isinstance(block, Bullets):
        return "\n".join(["<ul>", *(f"<li>{_escaped(line)}</li>" for line in block.lines), "</ul>"])
    if isinstance(block, Picture):
        data = base64.b64encode(block.png).decode("ascii")
        width = f"width:{block.width:g}mm"
        caption = f"<figcaption>{_escaped(block.caption)}</figcaption>" if block.caption else ""
        image = f'<img src="data:image/png;base64,{data}" alt="{_escaped(block.alternative)}" style="{width}" />'
        return f"<figure>{image}{caption}</figure>"
    return _table(block)


def _table(table: Table) -> str:
    wrong = [row for row in table.rows if len(row) != len(table.head)]
    if wrong:
        raise LithoformError(
            f"expected rows of {len(table.head)} cells, as the head of the table has; got one of {len(wrong[0])}."
        )
    lines = ['<div class="wide"><table>']
    if table.caption:
        lines.append(f"<caption>{_escaped(table.caption)}</caption>")
    head = (f'<th scope="col"{_class(table, i)}>{_escaped(text)}</th>' for i, text in enumerate(table.head))
    lines += [f"<thead><tr>{''.join(head)}</tr></thead>", "<tbody>"]
    for number, row in enumerate(table.rows):
        cells = []
        for i, given in enumerate(row):
            cell = given if isinstance(given, Cell) else Cell(given)
            if cell.tone not in TONES:
                raise LithoformError(f"expected a tone of {', '.join(TONES)}; got {cell.tone!r}.")
            tone = () if cell.tone == "plain" else (cell.tone,)
            text = _escaped(cell.text)
            # Names of many words may be broken between them, where a table is wide.
            text = text.replace("_", "_<wbr />") if i in table.texts else text
            cells.append(f"<td{_class(table, i, *tone)}>{text}</td>")
        lines.append(f"<tr{_classes('first' if number in table.groups else '')}>{''.join(cells)}</tr>")
    return "\n".join([*lines, "</tbody></table></div>"])


def _class(table: Table, column: int, *more: str) -> str:
    return _classes("text" if column in table.texts + table.long else "", "long" if column in table.long else "", *more)


def _classes(*names: str) -> str:
    used = " ".join(name for name in names if name)
    return f' class="{used}"' if used else ""


def _escaped(text: str) -> str:
    return html.escape(_NOT_XML.sub("\ufffd", text), quote=True)
