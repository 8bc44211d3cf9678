"""What a run that was stopped left behind: its state, and the looks at it on the way."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from lithoform.atomic import atomic_write
from lithoform.dem import Model, State
from lithoform.dem.checkpoint import read_checkpoint
from lithoform.errors import FileFormatError, OutputError, SceneError
from lithoform.packing.folder import CHECKPOINT_FILE, PROGRESS_FILE
from lithoform.packing.settling import LOOK, Schedule

__all__ = ["read_progress", "write_progress"]


def write_progress(out: Path, seconds: float, rows: list[dict[str, float]]) -> None:
    """Write progress.json: the time that was spent [s], and the looks so far."""
    atomic_write(out / PROGRESS_FILE, json.dumps({"seconds": seconds, "rows": rows}).encode())


def read_progress(out: Path, model: Model, start: State, plan: Schedule) -> tuple[State, list[dict[str, float]], float]:
    """State, looks and time spent [s] of a run that was stopped; those of the start where there is none.

    Raises
    ------
    OutputError
        If one of its files is damaged, or of another run.
    """
    checkpoint, progress = out / CHECKPOINT_FILE, out / PROGRESS_FILE
    if not (checkpoint.exists() and progress.exists()):
        return start, [], 0.0
    try:
        state = read_checkpoint(checkpoint, model)
    except SceneError as error:
        raise _lost(f"{checkpoint} is of other stones (have their files changed?) or another container") from error
    except FileFormatError as error:
        raise _lost(f"{checkpoint} is damaged or no checkpoint") from error
    try:
        told = json.loads(progress.read_bytes())
        rows, seconds = told["rows"], told["seconds"]
        good = all(map(_is_look, rows)) and _is_number(seconds) and seconds >= 0.0
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise _lost(f"{progress} is damaged") from error
    if not good:
        raise _lost(f"{progress} is damaged")
    if not _reach(rows, state, plan):
        raise _lost(f"{checkpoint} and {progress} are not of the same run, or damaged")
    return state, rows, float(seconds)


def _lost(what: str) -> OutputError:
    return OutputError(f"the packing cannot be resumed: {what}; give --overwrite to make it anew.")


def _is_look(row: Any) -> bool:
    is_whole = isinstance(row, dict) and set(row) == set(LOOK) and all(map(_is_number, row.values()))
    return is_whole and isinstance(row["step"], int)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond all floats
        return False


def _reach(rows: list[dict[str, float]], state: State, plan: Schedule) -> bool:
    """Whether the looks are those of a run up to a state: one an interval, the last at most an interval behind."""
    steps = [row["step"] for row in rows]
    expected = [min(k * plan.every, plan.steps) for k in range(len(steps))]
    return bool(steps) and steps == expected and steps[-1] >= state.step - plan.every and state.step <= plan.steps
