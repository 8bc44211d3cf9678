"""Fixtures of several test files."""

from __future__ import annotations

import pytest
from wavy import stone

from lithoform import LithoformError, cli


@pytest.fixture(scope="session")
def drawing() -> None:
    """Skip where no picture can be drawn."""
    from lithoform.rendering import render

    try:
        render(stone(n=2), size=(8, 8))
    except LithoformError as error:
        pytest.skip(f"no pictures here: {error}")


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    """Run the command in an empty folder; gives exit status, standard output and standard error."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as stop:
            cli.main(arguments)
        captured = capsys.readouterr()
        return stop.value.code or 0, captured.out, captured.err

    return call
