"""Speed of populations: 600 particles built on one core and on two, two populations compared, disk and memory a row.

python benchmarks/population.py [--per-class 150] [--rounds 3] [--large 1000000]
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table
from timing import one_core, peak_memory, seconds

from lithoform.comparison_report import write_report
from lithoform.database.building import Measures, build
from lithoform.database.population import read_population
from lithoform.database.queries import query
from lithoform.database.store import Store
from lithoform.descriptors.table import FOUR
from lithoform.planning import Plan
from lithoform.report.study import study
from lithoform.warp_runtime import default_threads

PLAN = """
from lithoform.planning import Plan
plan = Plan(count={count}, seed=0, preset='database', shape_class='mixed', base={{}})
for number in range(1, {count} + 1, {step}): plan.recipe(number)
"""


def plan(count: int, seed: int) -> Plan:
    return Plan(count=count, seed=seed, preset="database", shape_class="mixed", base={})


def built(folder: Path, count: int, *, seed: int, workers: int | None, measures: Measures | None = None) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    assert sum(1 for _ in build(folder, plan(count, seed), measures or Measures(("four",)), workers=workers)) == count
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--per-class", type=int, default=150)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--large", type=int, default=1_000_000)
    options = parser.parse_args()
    count, base = 4 * options.per_class, Path(tempfile.mkdtemp())
    table = Table(title=f"{count} particles, database setting, 20,000 triangles, generated, checked, measured, stored")
    for column in ("what", "seconds", "aim"):
        table.add_column(column, justify="left" if column == "what" else "right")
    try:
        times: dict[str, list[float]] = {"one": [], "two": [], "threads": []}
        for _ in range(options.rounds):
            with one_core():  # its worker inherits the one processor
                times["one"].append(seconds(lambda: built(base / "one", count, seed=0, workers=1)))
            times["two"].append(seconds(lambda: built(base / "two", count, seed=0, workers=2)))
            times["threads"].append(seconds(lambda: built(base / "threads", count, seed=0, workers=0)))
        one, two, threads = (statistics.median(times[key]) for key in ("one", "two", "threads"))
        table.add_row("four descriptors, Dask, one process on one core", f"{one:.1f}", "")
        table.add_row("four descriptors, Dask, two processes", f"{two:.1f}", "30")
        table.add_row(f"four descriptors, {default_threads()} threads of this process", f"{threads:.1f}", "")
        same = Store(base / "one").table().equals(Store(base / "two").table())
        built(base / "second", count, seed=1, workers=None)
        standard = seconds(lambda: built(base / "standard", count, seed=0, workers=None, measures=Measures()))
        table.add_row("standard set (the default), a process a core", f"{standard:.1f}", "")
        populations = [read_population(base / name, FOUR, by="class") for name in ("two", "second")]
        compared = seconds(lambda: write_report(lambda: study(*populations, seed=0, permutations=2000), base / "study"))
        table.add_row(f"compare {count} with {count}, by class, 2,000 permutations, with page and figures",
                      f"{compared:.1f}", "15")  # fmt: skip
        asked = seconds(lambda: query(base / "two", "select class, avg(roundness) from particles group by class"))
        table.add_row("a query", f"{asked:.2f}", "")
        size = sum(path.stat().st_size for path in Store(base / "standard").files)
    finally:
        shutil.rmtree(base, ignore_errors=True)
    console = Console(width=110)
    console.print(table)
    console.print(f"two cores against one: {one / two:.2f} times as fast (aim 1.7); same rows: {same}")
    console.print(f"{size / count:.0f} bytes a row in {count} rows of the standard set")
    rate = count / two
    hours, large = options.large / rate / 3600, options.large
    console.print(f"{rate:.1f} particles/s on two cores: {large:,} would take {hours:.1f} h (not run)")
    few, many = (peak_memory(PLAN.format(count=n, step=max(n // 10_000, 1))) for n in (10_000, large))
    console.print(f"memory of planning: {few:.0f} MB for 10,000 recipes, {many:.0f} MB for {large:,}")


if __name__ == "__main__":
    main()
