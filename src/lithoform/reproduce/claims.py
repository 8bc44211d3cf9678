"""What the paper says, tested on the files of its figures and tables made anew.

A claim is judged from the numbers in these files by a criterion that stands beside the verdict, never from what was
found before.  The verdict is of the conditions under which the files were made, which are stated: where NIST's
particles take the place of the paper's scans, "refuted" means that it does not hold for that rock.

- confirmed: the criterion is met.
- refuted: it is not met.
- not decided: the numbers are too uncertain, some are missing, or the conditions are too far from the paper's.
- not run: the files are not there.
"""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from lithoform.errors import FileFormatError
from lithoform.reproduce.files import csv_bytes

__all__ = ["HEAD", "VERDICTS", "Finding", "Rows", "claims_csv", "counts", "decided", "judged", "number", "read_rows"]

Verdict = Literal["confirmed", "refuted", "not decided", "not run"]
VERDICTS: Final[tuple[Verdict, ...]] = ("confirmed", "refuted", "not decided", "not run")

HEAD: Final = ("item", "claim", "verdict", "ours", "paper", "criterion", "condition")

Rows = list[dict[str, str]]
"""Of a CSV file: its columns by name."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A claim of the paper and what became of it.

    Attributes
    ----------
    item : str
        Name of the figure or table.
    claim : str
        In our words.
    verdict : {"confirmed", "refuted", "not decided", "not run"}
    ours, paper : str
        The numbers; empty where there are none.
    criterion : str
        By which it was judged.
    condition : str
        In what our conditions differ from the paper's; empty where they do not.
    """

    item: str
    claim: str
    verdict: Verdict
    ours: str = ""
    paper: str = ""
    criterion: str = ""
    condition: str = ""

    def cells(self) -> tuple[str, ...]:
        """As a row of a table with the head `HEAD`."""
        return (self.item, self.claim, self.verdict, self.ours, self.paper, self.criterion, self.condition)


def judged(truth: bool | None) -> Verdict:
    """Verdict of a criterion that is met, is not met, or cannot be told (None)."""
    return "not decided" if truth is None else "confirmed" if truth else "refuted"


def decided(truths: Iterable[bool | None]) -> bool | None:
    """Whether all of several hold: one that does not is enough to say no, and one that cannot be told leaves it open.

    None of none.
    """
    found = list(truths)
    if False in found:
        return False
    return None if None in found or not found else True


def number(text: str | None) -> float:
    """A number of a cell; NaN where the cell is empty or holds none."""
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan


def read_rows(path: Path, columns: Sequence[str]) -> Rows:
    """Rows of a CSV file that has certain columns.

    Raises
    ------
    FileFormatError
        If it cannot be read or lacks one of them.
    """
    try:
        reader = csv.DictReader(io.StringIO(path.read_bytes().decode("utf-8")))
        rows = list(reader)
    except (OSError, ValueError, csv.Error) as error:
        raise FileFormatError(f"{path} cannot be read ({error}): remove it, and make it again.") from error
    absent = [name for name in columns if name not in (reader.fieldnames or ())]
    if absent:
        raise FileFormatError(
            f"expected a column {absent[0]!r} in {path}, which has none: remove it, and make it again."
        )
    return rows


def counts(findings: Iterable[Finding]) -> dict[str, int]:
    """How many there are of each verdict, in the order of `VERDICTS`."""
    found = Counter(finding.verdict for finding in findings)
    return {verdict: found[verdict] for verdict in VERDICTS}


def claims_csv(findings: Iterable[Finding]) -> bytes:
    """Table with a row a claim."""
    return csv_bytes(HEAD, (finding.cells() for finding in findings))
