"""Fixtures of several test files."""

from __future__ import annotations

import pytest
from wavy import stone

from lithoform import LithoformError


@pytest.fixture(scope="session")
def drawing() -> None:
    """Skip where no picture can be drawn."""
    from lithoform.rendering import render

    try:
        render(stone(n=2), size=(8, 8))
    except LithoformError as error:
        pytest.skip(f"no pictures here: {error}")
