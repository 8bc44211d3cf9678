"""Everything of the paper in one folder: what is there, what is missing, and the making of the rest, one by one."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, Literal

from lithoform.atomic import atomic_write
from lithoform.errors import FileFormatError, LithoformError, RecipeError
from lithoform.locking import folder_lock
from lithoform.reproduce import FIGURES, PAPER, Reproduction
from lithoform.reproduce.claims import Finding
from lithoform.reproduce.files import made_folder
from lithoform.sidecar import program_version

__all__ = [
    "RECORD_FILE", "Outcome", "chosen", "find_claims", "listing", "make_all", "make_one", "obstacle",
    "plain_outcomes", "read_record", "state_of",
]  # fmt: skip

RECORD_FILE: Final = "reproduced.json"
"""Options and times of what was made, by name."""

_CLAIMS: Final = {
    "fig4": ("claims_of_shape", "figure_4"), "fig5": ("claims_of_shape", "figure_5"),
    "fig6": ("claims_of_shape", "figure_6"), "fig7": ("claims_of_shape", "figure_7"),
    "fig8": ("claims_of_populations", "figure_8"), "table3": ("claims_of_populations", "table_3"),
    "fig9": ("claims_of_populations", "figure_9"), "table4": ("claims_of_populations", "table_4"),
    "fig10": ("claims_of_populations", "figure_10"), "table5": ("claims_of_populations", "table_5"),
    "fig12": ("claims_of_compaction", "figure_12"), "fig13": ("claims_of_compaction", "figure_13"),
    "table6": ("claims_of_compaction", "table_6"),
}  # fmt: skip
"""Functions of a folder, or of None where the item is not made, that give its findings."""

_NEED_SCANS: Final = frozenset({"fig8", "table3", "fig9", "table4", "fig10", "table5", "fig12", "fig13", "table6"})
_PICTURE_PACKAGES: Final = ("pyvista", "matplotlib", "PIL")

State = Literal["made", "there", "failed", "left out"]


@dataclass(frozen=True)
class Outcome:
    """What became of an item.

    Attributes
    ----------
    name : str
    state : {"made", "there", "failed", "left out"}
        Made now; there already and complete; not made, for a reason; not asked for.
    detail : str
        The reason, in a sentence.
    seconds : float
        Wall-clock time of the making now.
    """

    name: str
    state: State
    detail: str = ""
    seconds: float = 0.0


def chosen(only: Sequence[str], skip: Sequence[str]) -> list[str]:
    """Names of the items to be made, in the order of the paper.

    Raises
    ------
    RecipeError
        If a name is unknown, or nothing is left.
    """
    for option, names in (("--only", only), ("--skip", skip)):
        for name in names:
            if name not in FIGURES:
                reason = f"; {PAPER[name].title} is not made by a command" if name in PAPER else ""
                raise RecipeError(f"expected names of {', '.join(FIGURES)} after {option}; got {name!r}{reason}.")
    left = [name for name in FIGURES if (not only or name in only) and name not in skip]
    if not left:
        raise RecipeError("--only and --skip leave nothing to be made; name an item that is not skipped.")
    return left


def read_record(out: Path) -> dict[str, dict[str, Any]]:
    """What the folder tells of the making of its items; empty where it tells nothing."""
    try:
        told = json.loads((out / RECORD_FILE).read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    items = told.get("items") if isinstance(told, dict) else None
    return {k: v for k, v in items.items() if isinstance(v, dict)} if isinstance(items, dict) else {}


def _note(out: Path, name: str, options: dict[str, Any], seconds: float) -> None:
    items = {**read_record(out), name: {"lithoform": program_version(), "options": options,
                                        "seconds": round(seconds, 1)}}  # fmt: skip
    ordered = {key: items[key] for key in PAPER if key in items}
    atomic_write(out / RECORD_FILE, (json.dumps({"items": ordered}, indent=2) + "\n").encode())


def obstacle(row: Reproduction) -> str:
    """Why an item cannot be made here: a package or the scans are missing; empty where nothing is known to be."""
    if any(find_spec(name) is None for name in _PICTURE_PACKAGES):
        return "the extra 'pictures' is not installed"
    if row.name in _NEED_SCANS:
        from lithoform.reproduce.populations import FOLDER_VARIABLE, find_reference

        try:
            find_reference()
        except FileFormatError:
            return f"the scans of FDOT-57 are not here: name their folder in {FOLDER_VARIABLE}"
    return ""


def state_of(row: Reproduction, out: Path) -> tuple[str, str]:
    """State of an item in a folder by a look at its files, and the reason: what is missing, or what stands for it.

    The state is one of made, not made, incomplete, impossible (here), and given (not made anew).
    """
    if not row.module:
        return "given", row.represented
    missing = row.missing(out)
    if not missing:
        return "made", ""
    why = obstacle(row)
    if why:
        return "impossible", why
    return ("not made", "") if len(missing) == len(row.files) else ("incomplete", f"there is no {', '.join(missing)}")


def listing(out: Path) -> list[dict[str, Any]]:
    """All figures and tables of the paper: first those that are made, each part in the paper's order; plain values."""
    record = read_record(out)
    rows = []
    for row in (*FIGURES.values(), *(row for row in PAPER.values() if not row.module)):
        state, reason = state_of(row, out)
        rows.append({
            "figure": row.name, "meaning": row.meaning, "kind": row.kind, "section": row.section,
            "command": row.command or None, "cost": row.cost or None, "state": state, "reason": reason or None,
            "seconds": record.get(row.name, {}).get("seconds"), "files": [*row.files],
        })  # fmt: skip
    return rows


def make_one(name: str, out: Path, options: dict[str, Any]) -> list[Path]:
    """Make an item, and note its options and its time in the folder.

    Parameters
    ----------
    name : str
        Of `FIGURES`.
    out : Path
    options : dict
        seed, triangles and device, as far as they are given.

    Raises
    ------
    LithoformError
        As the function that makes it.
    """
    began = time.perf_counter()
    files = FIGURES[name].make(out, **options)
    # Fig. 2 also takes the name of a picture, which is no folder to note anything in.
    if out.is_dir():
        _note(out, name, options, time.perf_counter() - began)
    return files


def make_all(
    out: Path,
    options: dict[str, Any],
    *,
    names: Iterable[str] = tuple(FIGURES),
    overwrite: bool = False,
    told: Callable[[str], object] = lambda _: None,
) -> list[Outcome]:
    """Make the items that are not there, in the order of the paper, and the report; past those that cannot be made.

    An item is there if all its files are, and it was not made with other options.  Interrupted, the same call goes on;
    the report is written then too, of what is there.

    Parameters
    ----------
    out : Path
    options : dict
        As `make_one`.
    names : iterable of str
        Of `FIGURES`: those to be made.
    overwrite : bool
        Make them even if they are there.
    told : callable
        Is told of each item, a line at a time.

    Returns
    -------
    list of Outcome
        One for each of `FIGURES`.

    Raises
    ------
    OutputError
        If the folder or the report cannot be written, or another run is at work there.
    """
    from lithoform.reproduce.report import write_report

    out = made_folder(out)
    wanted, outcomes = set(names), []
    with folder_lock(out):
        try:
            for row in FIGURES.values():
                outcome = _made(row, out, options, overwrite=overwrite) if row.name in wanted else _left(row, out)
                outcomes.append(outcome)
                if row.name in wanted:
                    told(_sentence(outcome))
        finally:
            seen = {outcome.name for outcome in outcomes}
            rest = [_left(row, out) for row in FIGURES.values() if row.name not in seen]
            write_report(out, [*outcomes, *rest], find_claims(out), read_record(out))
    return outcomes


def _left(row: Reproduction, out: Path) -> Outcome:
    return Outcome(row.name, "left out" if row.missing(out) else "there")


def _made(row: Reproduction, out: Path, options: dict[str, Any], *, overwrite: bool) -> Outcome:
    former = read_record(out).get(row.name, {}).get("options", options)
    if not overwrite and not row.missing(out) and _deciding(former) == _deciding(options):
        return Outcome(row.name, "there")
    began = time.perf_counter()
    try:
        make_one(row.name, out, options)
    except LithoformError as error:
        return Outcome(row.name, "failed", _plain(error))
    except MemoryError:
        return Outcome(row.name, "failed", "the memory was not enough.")
    except Exception as error:
        # A fault in one item is no reason to lose the others.
        return Outcome(row.name, "failed", f"it failed unexpectedly ({type(error).__name__}: {_plain(error)}).")
    missing = row.missing(out)
    if missing:
        return Outcome(row.name, "failed", f"it was made without {', '.join(missing)}.")
    return Outcome(row.name, "made", seconds=time.perf_counter() - began)


def _deciding(options: dict[str, Any]) -> dict[str, Any]:
    """Options by which two makings differ: where it is computed is none of them."""
    return {key: value for key, value in options.items() if key != "device" and value is not None}


def _plain(error: Exception) -> str:
    return " ".join(str(error).split())


def _sentence(outcome: Outcome) -> str:
    more = {"made": f"made, {outcome.seconds:.0f} s", "there": "is there", "failed": f"not made: {outcome.detail}"}
    return f"{outcome.name}: {more.get(outcome.state, outcome.state)}"


def find_claims(out: Path) -> list[Finding]:
    """What the paper says of its figures and tables, judged by the files of a folder."""
    found: list[Finding] = []
    for name, (module, function) in _CLAIMS.items():
        judge = getattr(import_module(f"lithoform.reproduce.{module}"), function)
        try:
            found += judge(None if FIGURES[name].missing(out) else out)
        except FileFormatError as error:
            found.append(Finding(item=name, claim="all claims on it", verdict="not decided", ours=_plain(error)))
    return found


def plain_outcomes(outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """Outcomes in plain values."""
    return [asdict(outcome) for outcome in outcomes]
