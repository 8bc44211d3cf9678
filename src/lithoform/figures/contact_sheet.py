"""Contact sheet of a database: for every source, a row of stones a class, each stone as large as its cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.errors import LithoformError
from lithoform.figures.sheet import GREY, sheet
from lithoform.mesh import Mesh
from lithoform.rendering import STONE, VIEW, Studio, load_module

__all__ = ["ClassRow", "Section", "contact_sheet"]

_CELL: Final = (22.0, 19.0)  # [mm]
_LABEL, _EDGE, _CAPTION, _HEADING, _TITLE, _GAP = 17.0, 4.0, 4.2, 7.0, 8.0, 2.0  # [mm]
_DPI: Final = 200
_RULE: Final = "#d8d4cc"


@dataclass(frozen=True)
class ClassRow:
    """Stones of one class.

    Attributes
    ----------
    label : str
    stones : sequence of (str, Mesh)
        A caption and the stone; meshes in any unit.
    """

    label: str
    stones: Sequence[tuple[str, Mesh]]


@dataclass(frozen=True)
class Section:
    """Rows of one source under a heading."""

    heading: str
    rows: Sequence[ClassRow]


def contact_sheet(
    sections: Sequence[Section], *, title: str | None = None, note: str = "", dpi: int = _DPI
) -> np.ndarray:
    """Rows of stones, source by source, class by class, each stone filling its cell.

    Parameters
    ----------
    sections : sequence of Section
    title : str, optional
    note : str
        What the captions tell, under the last row.
    dpi : int
        Pixels per inch.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
        On one machine, the same stones give the same pixels; `lithoform.figures.gallery.png_bytes` makes a file of
        them.

    Raises
    ------
    LithoformError
        If a section has no rows, a row has no stones, or the stones cannot be drawn.
    """
    if not sections or not all(s.rows and all(row.stones for row in s.rows) for s in sections):
        raise LithoformError("a contact sheet needs at least one section, rows in each, and stones in each row.")
    columns = max(len(row.stones) for section in sections for row in section.rows)
    row_height = _CELL[1] + _CAPTION + _GAP
    # So wide that the name of a source has room over few stones too.
    width = max(2 * _EDGE + _LABEL + columns * _CELL[0], 130.0)
    head = _EDGE + (_TITLE if title else 0.0)
    height = head + sum(_HEADING + len(section.rows) * row_height for section in sections)
    height += _EDGE + (_HEADING if note else 0.0)
    with sheet(width, height, dpi) as page:
        size = page.to_pixels(_CELL[0]), page.to_pixels(_CELL[1])
        if title:
            page.text(_EDGE, _EDGE + 0.4 * _TITLE, title, size=11, ha="left", weight="bold", parse_math=False)
        top = head
        with Studio(size, VIEW, STONE) as studio:
            for section in sections:
                page.text(_EDGE, top + 0.5 * _HEADING, section.heading, size=8.5, ha="left", parse_math=False)
                line = load_module("matplotlib.lines").Line2D(
                    [_EDGE / width, 1.0 - _EDGE / width], [1.0 - (top + 0.2) / height] * 2, color=_RULE, linewidth=0.6
                )
                page.figure.add_artist(line)
                top += _HEADING
                for row in section.rows:
                    page.text(_EDGE, top + 0.5 * _CELL[1], row.label, size=8.5, ha="left", weight="bold",
                              parse_math=False)  # fmt: skip
                    for i, (caption, mesh) in enumerate(row.stones):
                        left = _EDGE + _LABEL + i * _CELL[0]
                        page.paste(studio.picture(mesh), left, top)
                        page.text(left + 0.5 * _CELL[0], top + _CELL[1] + 0.5 * _CAPTION, caption, size=6,
                                  color=GREY, parse_math=False)  # fmt: skip
                    top += row_height
        if note:
            page.text(_EDGE, top + 0.5 * _HEADING, note, size=7, ha="left", color=GREY, parse_math=False)
        return page.pixels()
