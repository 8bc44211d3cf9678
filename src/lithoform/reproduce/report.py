"""The page of all figures and tables: ours beside the paper's, and what became of its claims."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from lithoform.atomic import atomic_write
from lithoform.report.page import Block, Bullets, Cell, Page, Paragraph, Picture, Table
from lithoform.reproduce import FIGURES, PAPER, SHARED, Reproduction
from lithoform.reproduce.claims import VERDICTS, Finding, claims_csv, counts

if TYPE_CHECKING:
    from lithoform.reproduce.overview import Outcome

__all__ = ["CLAIMS_FILE", "REPORT_FILE", "write_report"]

REPORT_FILE: Final = "report.html"
CLAIMS_FILE: Final = "claims.csv"

_WIDEST: Final = 1000  # pixels of a picture on the page
_COLOURS: Final = 128
_LONGEST: Final = 100  # rows of a table on the page
_TONES: Final = {"confirmed": "same", "refuted": "strong", "not decided": "open", "not run": "plain"}
_STATES: Final = {"made": "same", "there": "same", "failed": "strong", "left out": "open"}
_TOLD: Final = {"made": "made", "there": "made", "failed": "not made", "left out": "not made"}
_TABLES: Final = {
    "fig4": ("fig4b.csv",), "fig7": ("fig7.csv",), "fig8": ("fig8.csv",), "fig9": ("fig9.csv",),
    "fig10": ("fig10.csv",), "fig12": ("fig12.csv", "fig12_sources.csv"), "table3": ("table3.csv",),
    "table4": ("table4.csv",), "table5": ("table5.csv",), "table6": ("table6.csv",),
}  # fmt: skip
"""Files that stand on the page as tables, with the paper's numbers in a column of their own where it prints any."""

_VERDICTS_SAY: Final = (
    "A verdict is of the conditions under which the files of this folder were made, which the last column names. Where "
    "other scans take the place of the paper's, refuted means: not so for that rock."
)


def write_report(
    out: Path, outcomes: Sequence[Outcome], findings: Sequence[Finding], record: dict[str, dict[str, Any]]
) -> None:
    """Write report.html and claims.csv.

    Parameters
    ----------
    out : Path
        Folder with the files of the items.
    outcomes : sequence of Outcome
        Of each item that can be made.
    findings : sequence of Finding
    record : dict
        Options and seconds of what was made, by name.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    atomic_write(out / CLAIMS_FILE, claims_csv(findings))
    atomic_write(out / REPORT_FILE, _page(out, {row.name: row for row in outcomes}, findings, record).to_bytes())


def _page(
    out: Path, outcomes: dict[str, Outcome], findings: Sequence[Finding], record: dict[str, dict[str, Any]]
) -> Page:
    page = Page("Figures and tables of the paper made anew")
    total = counts(findings)
    is_there = [name for name, row in FIGURES.items() if not row.missing(out)]
    page.add(
        Bullets((
            f"{len(is_there)} of {len(FIGURES)} are here; {len(PAPER) - len(FIGURES)} others are drawings or inputs.",
            f"Claims of the paper: {', '.join(f'{number} {verdict}' for verdict, number in total.items())}.",
        )),
        _overview(outcomes, record),
    )  # fmt: skip
    for verdict in VERDICTS:
        rows = [finding for finding in findings if finding.verdict == verdict]
        title = f"{verdict[0].upper()}{verdict[1:]}: {len(rows)}"
        page.section(title, _claims(rows) if rows else Paragraph("None."))
        if verdict == VERDICTS[0]:
            page.add(Paragraph(_VERDICTS_SAY))
    for row in FIGURES.values():
        page.section(f"{row.title}: {row.meaning}", *_item(row, out, outcomes.get(row.name), record.get(row.name, {})))
    return page


def _overview(outcomes: dict[str, Outcome], record: dict[str, dict[str, Any]]) -> Table:
    lines: list[tuple[str | Cell, ...]] = []
    for row in PAPER.values():
        outcome = outcomes.get(row.name)
        state: str | Cell = "given"
        why = row.represented
        if outcome is not None:
            state, why = Cell(_TOLD[outcome.state], _STATES[outcome.state]), outcome.detail
        seconds = record.get(row.name, {}).get("seconds")
        spent = f"{seconds:.0f} s" if isinstance(seconds, (int, float)) else ""
        name, command = _unbroken(row.title), _unbroken(row.command.removeprefix("lithoform ") or "-")
        cost = ", ".join(map(_unbroken, (row.cost or "-").split(", ")))
        lines.append((name, row.meaning, row.section, state, command, cost, spent, why))
    head = ("", "meaning", "section", "state", "command", "cost", "here", "")
    caption = f"Given: not made anew. Cost: wall-clock time on two cores. {SHARED} Here: what it took in this folder."
    return Table(head, tuple(lines), caption, texts=(0, 2, 3, 4, 5), long=(1, 7))


def _unbroken(text: str) -> str:
    return text.replace(" ", "\u00a0")


def _claims(rows: Iterable[Finding]) -> Table:
    lines = tuple(
        (_unbroken(PAPER[row.item].title), row.claim, row.ours or "-", row.paper or "-", row.criterion, row.condition)
        for row in rows
    )
    return Table(("", "claim", "ours", "paper", "criterion", "condition"), lines, texts=(0,), long=(1, 2, 3, 4, 5))


def _item(row: Reproduction, out: Path, outcome: Outcome | None, record: dict[str, Any]) -> list[Block]:
    blocks: list[Block] = []
    options = record.get("options", {})
    given = ", ".join(f"{key} {value}" for key, value in options.items() if value is not None)
    made_with = f" Options: {given}." if given else ""
    blocks.append(Paragraph(f"{row.command}: {row.cost}.{made_with}"))
    if outcome is not None and outcome.state == "failed":
        blocks.append(Paragraph(f"Not made: {outcome.detail}"))
    missing = row.missing(out)
    if missing:
        return [*blocks, Paragraph(f"Not here: {', '.join(missing)}.")]
    for name in row.files:
        if name.endswith(".png"):
            picture = _small((out / name).read_bytes())
            blocks.append(Picture(picture, f"{row.title}: {row.meaning}", caption=name, width=200.0))
    return blocks + [_table(out / name) for name in _TABLES.get(row.name, ())]


def _table(path: Path) -> Block:
    rows = list(csv.reader(io.StringIO(path.read_bytes().decode("utf-8", errors="replace"))))
    if len(rows) < 2:
        return Paragraph(f"{path.name} holds no rows.")
    head, body = rows[0], [row for row in rows[1:] if len(row) == len(rows[0])]
    texts = tuple(i for i in range(len(head)) if any(_is_word(row[i]) for row in body))
    caption = path.name if len(body) <= _LONGEST else f"{path.name}: the first {_LONGEST} of {len(body)} rows"
    shown = tuple(tuple(map(_short, row)) for row in body[:_LONGEST])
    return Table(tuple(head), shown, caption, texts=texts)


def _is_word(text: str) -> bool:
    if not text:
        return False
    try:
        float(text)
    except ValueError:
        return True
    return False


def _short(text: str) -> str:
    """A number of many digits in five."""
    try:
        value = float(text)
    except ValueError:
        return text
    return f"{value:.5g}" if len(text) > 7 and math.isfinite(value) else text


def _small(png: bytes) -> bytes:
    """A picture no wider than the page needs; as it is where Pillow is not installed or cannot read it."""
    try:
        from PIL import Image
    except ImportError:
        return png
    try:
        with Image.open(io.BytesIO(png)) as image:
            image.load()
            picture = image.convert("RGB")
    except (OSError, ValueError):
        return png
    if picture.width > _WIDEST:
        height = max(1, round(picture.height * _WIDEST / picture.width))
        picture = picture.resize((_WIDEST, height), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    picture.quantize(_COLOURS).save(file, "PNG", optimize=True)
    return min(file.getvalue(), png, key=len)
