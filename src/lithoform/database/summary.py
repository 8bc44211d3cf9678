"""What a database holds: counts, failures, moments, sizes on the disk; aggregated where the rows are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from lithoform.database.queries import query
from lithoform.database.store import Source, Store
from lithoform.descriptors.table import DESCRIPTORS, FOUR
from lithoform.presets import SHAPE_CLASSES

__all__ = ["SUMMARISED", "Moments", "SourceSummary", "Summary", "describe", "pick_examples", "summarise"]

SUMMARISED: Final = (*FOUR, "length", "width", "thickness", "sieve_size")
"""Descriptors whose moments are told: the four of the paper and the dimensions."""

_REASONS: Final = 3
_EXAMPLES: Final = 3
_LISTED: Final = 4
_DIGITS: Final = 12
"""DuckDB adds up in an order that the threads decide; so many digits do not feel it."""


@dataclass(frozen=True)
class Moments:
    """Distribution of one descriptor in one source.

    Attributes
    ----------
    count : int
        Particles of which it was measured.
    mean, deviation : float
        Mean, and standard deviation with n - 1 (None for one particle) [of the descriptor, in metres].
    least, low, median, high, greatest : float
        Least value, 5 %, 50 % and 95 % quantiles (linear between neighbours), greatest value.
    """

    count: int
    mean: float
    deviation: float | None
    least: float
    low: float
    median: float
    high: float
    greatest: float


@dataclass(frozen=True)
class SourceSummary:
    """What is there of one source.

    Attributes
    ----------
    name, kind, lithoform : str
        As `Source`.
    asked, rows, failed, missing : int
        Particles that it has when complete; rows that are there; those of them in error; particles still to be made.
    classes : dict of str to int
        Particles without error by class.
    reasons : tuple of (int, str)
        Number and error of the first that failed.
    moments : dict of str to Moments
        Of the `SUMMARISED` descriptors that were measured.
    row_bytes, mesh_bytes : int
        Size of its files.
    settings : dict
        What was asked for; of the files of an import, their number.
    """

    name: str
    kind: str
    lithoform: str
    asked: int
    rows: int
    failed: int
    missing: int
    classes: dict[str, int]
    reasons: tuple[tuple[int, str], ...]
    moments: dict[str, Moments]
    row_bytes: int
    mesh_bytes: int
    settings: dict[str, Any]

    @property
    def good(self) -> int:
        """Particles without error."""
        return self.rows - self.failed

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""
        reasons = [{"number": number, "error": error} for number, error in self.reasons]
        return {**vars(self), "reasons": reasons, "moments": {k: vars(v) for k, v in self.moments.items()}}


@dataclass(frozen=True)
class Summary:
    """What a database holds.

    Attributes
    ----------
    sources : tuple of SourceSummary
    duplicated_meshes, duplicate_particles : int
        Meshes that more than one particle has, and the particles that have them.
    duplicates : tuple of tuple of str
        The first of these, as "source number".
    """

    sources: tuple[SourceSummary, ...]
    duplicated_meshes: int
    duplicate_particles: int
    duplicates: tuple[tuple[str, ...], ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "particles": sum(source.good for source in self.sources),
            "failed": sum(source.failed for source in self.sources),
            "missing": sum(source.missing for source in self.sources),
            "row_bytes": sum(source.row_bytes for source in self.sources),
            "mesh_bytes": sum(source.mesh_bytes for source in self.sources),
            "duplicated_meshes": self.duplicated_meshes,
            "duplicate_particles": self.duplicate_particles,
            "duplicates": [list(group) for group in self.duplicates],
            "sources": [source.as_dict() for source in self.sources],
        }


def summarise(store: Store) -> Summary:
    """Counts, failures, duplicates, moments and sizes of a database, of a million rows as of a hundred.

    Raises
    ------
    FileFormatError
        If a file of it is damaged.
    """
    counts: dict[str, dict[str | None, int]] = {name: {} for name in store.sources}
    failed = dict.fromkeys(store.sources, 0)
    for row in query(
        store,
        "select source, class, count(*) filter (error is null) as good, count(error) as failed from particles "
        "group by source, class order by source, class",
    ).to_pylist():
        counts[row["source"]][row["class"]] = row["good"]
        failed[row["source"]] += row["failed"]
    reasons: dict[str, list[tuple[int, str]]] = {name: [] for name in store.sources}
    for row in query(
        store,
        "select source, number, error from particles where error is not null "
        f"qualify row_number() over (partition by source order by number) <= {_REASONS} order by source, number",
    ).to_pylist():
        reasons[row["source"]].append((row["number"], row["error"]))
    moments = _moments(store)
    missing = store.missing()
    sources = []
    for source in store.sources.values():
        good = sum(counts[source.name].values())
        found = (
            good + failed[source.name], failed[source.name], missing.get(source.name, 0),
            _in_order(counts[source.name]), tuple(reasons[source.name]), moments.get(source.name, {}),
            *_sizes(store, source), _settings(source),
        )  # fmt: skip
        sources.append(SourceSummary(source.name, source.kind, source.lithoform, source.count, *found))
    return Summary(tuple(sources), *_duplicates(store))


def _in_order(counts: dict[str | None, int]) -> dict[str, int]:
    known = {name: counts[name] for name in SHAPE_CLASSES if counts.get(name)}
    # A row that failed before it was measured has no class.
    return known | {name or "none": n for name, n in counts.items() if n and name not in known}


def _moments(store: Store) -> dict[str, dict[str, Moments]]:
    parts = [
        f"count({x}) as {x}_0, favg({x}) as {x}_1, stddev_samp({x}) as {x}_2, min({x}) as {x}_3, "
        f"quantile_cont({x}, [0.05, 0.5, 0.95]) as {x}_4, max({x}) as {x}_5"
        for x in SUMMARISED
    ]
    rows = query(store, f"select source, {', '.join(parts)} from particles where error is null group by source")
    return {
        row["source"]: {
            name: Moments(row[f"{name}_0"], *map(_rounded, (
                row[f"{name}_1"], row[f"{name}_2"], row[f"{name}_3"], *row[f"{name}_4"], row[f"{name}_5"]
            )))
            for name in SUMMARISED
            if row[f"{name}_0"]
        }
        for row in rows.to_pylist()
    }  # fmt: skip


def _rounded(value: float | None) -> Any:
    return None if value is None else float(f"{value:.{_DIGITS}g}")


def _duplicates(store: Store) -> tuple[int, int, tuple[tuple[str, ...], ...]]:
    repeated = (
        "select content_hash, count(*) as n, min(number) as first from particles where error is null and "
        "content_hash is not null group by content_hash having count(*) > 1"
    )
    total = query(store, f"select count(*) as meshes, coalesce(sum(n), 0)::bigint as particles from ({repeated})")
    meshes, particles = total["meshes"][0].as_py(), total["particles"][0].as_py()
    if not meshes:
        return 0, 0, ()
    first = query(
        store,
        f"with repeated as ({repeated} order by first, content_hash limit {_EXAMPLES}) "
        "select array_agg(concat(source, ' ', number) order by source, number) as names from particles join repeated "
        "using (content_hash) where error is null group by content_hash, first order by first, content_hash",
    )
    return meshes, particles, tuple(map(tuple, first["names"].to_pylist()))


def _sizes(store: Store, source: Source) -> tuple[int, int]:
    """Bytes of the rows and of the kept meshes of a source."""
    sizes = [0, 0]
    for batch in store.present(source):
        for meshes in (False, True)[: 1 + source.keeps_meshes]:
            path = store.path(source, batch, meshes=meshes)
            # A writer may be at work; and a mesh file that was lost is no fault of the rows.
            sizes[meshes] += path.stat().st_size if path.exists() else 0
    return sizes[0], sizes[1]


def _settings(source: Source) -> dict[str, Any]:
    told = {key: len(value) if key == "files" else value for key, value in source.plan.items()}
    return {**told, "keep_meshes": source.keeps_meshes, "batch": source.batch}


def pick_examples(store: Store, each: int, *, seed: int = 0) -> list[tuple[str, str, int]]:
    """Some particles of every class of every source, as (source, class, number), always the same for a seed.

    Parameters
    ----------
    store : Store
    each : int
        Of a class of a source, at most.
    seed : int
    """
    # MD5, which is the same in every version of DuckDB; its hash() is not.
    rows = query(
        store,
        "select source, class, number from particles where error is null and class is not null qualify row_number() "
        f"over (partition by source, class order by md5(concat({int(seed)}, '/', source, '/', number)), number) "
        f"<= {int(each)} order by number",
    )
    order = {name: place for place, name in enumerate(store.sources)}
    classes = {name: place for place, name in enumerate(SHAPE_CLASSES)}
    found = [(row["source"], row["class"], row["number"]) for row in rows.to_pylist()]
    return sorted(found, key=lambda item: (order[item[0]], classes.get(item[1], len(classes)), item[1], item[2]))


def describe(found: Summary) -> str:
    """A summary as lines of text, lengths in millimetres."""
    total = found.as_dict()
    disk = _disk(total["row_bytes"], total["mesh_bytes"])
    lines = [f"{total['particles']:,} particles of {_counted(len(found.sources), 'source')}; {disk}"]
    if found.duplicated_meshes:
        names = "; ".join(" and ".join(group[:4]) for group in found.duplicates)
        more = "; ..." if found.duplicated_meshes > len(found.duplicates) else ""
        lines.append(f"duplicates: {found.duplicate_particles:,} particles share "
                     f"{_counted(found.duplicated_meshes, 'mesh')} ({names}{more})")  # fmt: skip
    for source in found.sources:
        lines += ["", *_describe_source(source)]
    return "\n".join(lines)


def _describe_source(source: SourceSummary) -> list[str]:
    lines = [
        f"{source.name}: {source.good:,} of {source.asked:,} particles, {source.kind}, lithoform {source.lithoform}"
    ]
    if source.classes:
        lines.append(f"  classes   {', '.join(f'{name} {count:,}' for name, count in source.classes.items())}")
    if source.failed:
        lines.append(f"  failed    {source.failed:,}")
        lines += [f"            {number}: {error}" for number, error in source.reasons]
    if source.missing:
        lines.append(f"  missing   {source.missing:,}: the command that makes this source goes on where it stopped")
    settings = {**source.settings, **source.settings.get("base", {})}
    told = ", ".join(f"{key.replace('_', ' ')}: {_word(value)}" for key, value in settings.items() if key != "base")
    lines.append(f"  settings  {told}")
    lines.append(f"  disk      {_disk(source.row_bytes, source.mesh_bytes)}")
    if source.moments:
        heads = ("n", "mean", "deviation", "least", "5 %", "median", "95 %", "greatest")
        lines.append(" " * 18 + "".join(f"{head:>10}" for head in heads))
    for name, m in source.moments.items():
        factor, unit = (1e3, " [mm]") if DESCRIPTORS[name].power == 1 else (1.0, "")
        values = (m.mean, m.deviation, m.least, m.low, m.median, m.high, m.greatest)
        cells = "".join(f"{'' if v is None else f'{factor * v:.4g}':>10}" for v in values)
        lines.append(f"  {name + unit:16}{m.count:10,}{cells}")
    return lines


def _word(value: Any) -> str:
    if isinstance(value, list):
        return " ".join(map(str, value)) if len(value) <= _LISTED else str(len(value))
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "none" if value is None else str(value)


def _disk(rows: int, meshes: int) -> str:
    return f"rows {_bytes(rows)}, meshes {_bytes(meshes)}"


def _counted(count: int, noun: str) -> str:
    plural = f"{noun}es" if noun.endswith("sh") else f"{noun}s"
    return f"{count:,} {noun if count == 1 else plural}"


def _bytes(count: int) -> str:
    if count < 1000:
        return f"{count} B"
    size, unit = count / 1000.0, 0
    while size >= 1000.0 and unit < 3:
        size, unit = size / 1000.0, unit + 1
    return f"{size:.3g} {('kB', 'MB', 'GB', 'TB')[unit]}"
