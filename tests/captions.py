"""What the tests of figures share: the texts that a sheet shows, and whether each stands clear of the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from lithoform.figures.sheet import Sheet


@dataclass(frozen=True)
class Caption:
    """A text and the rectangle that it fills, from the bottom left [pixels]."""

    text: str
    left: float
    bottom: float
    right: float
    top: float


def record_captions(monkeypatch: pytest.MonkeyPatch) -> list[Caption]:
    """A list that takes up the texts of every sheet from now on, and fails if one lies on another or runs off."""
    captions: list[Caption] = []
    draw = Sheet.pixels

    def pixels(page: Sheet) -> np.ndarray:
        from matplotlib.text import Text

        picture = draw(page)
        new = []
        for text in page.figure.findobj(Text):
            if text.get_visible() and text.get_text().strip():
                box = text.get_window_extent()
                new.append(Caption(text.get_text(), box.x0, box.y0, box.x1, box.y1))
        _assert_clear(new, picture.shape)
        captions.extend(new)
        return picture

    monkeypatch.setattr(Sheet, "pixels", pixels)
    return captions


def _assert_clear(captions: list[Caption], shape: tuple[int, ...]) -> None:
    for i, one in enumerate(captions):
        assert min(one.left, one.bottom) >= 0, one
        assert one.right <= shape[1], one
        assert one.top <= shape[0], one
        for other in captions[:i]:
            width = min(one.right, other.right) - max(one.left, other.left)
            height = min(one.top, other.top) - max(one.bottom, other.bottom)
            # Extents are rounded up to whole pixels.
            assert min(width, height) <= 1.0, (one, other)
