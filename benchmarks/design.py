"""Speed of inverse design: a first answer, a refined one, the studio's redraw, and a whole one-at-a-time sweep.

python benchmarks/design.py [--sweep]
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from timing import seconds

from lithoform import Recipe, generate, measure
from lithoform.database.building import Measures, build
from lithoform.inverse.design import by_search
from lithoform.inverse.library import shipped_library
from lithoform.inverse.targets import parse_target
from lithoform.sensitivity.designs import OneAtATime

TARGET = "roundness=0.30,boxiness=0.42,solidity=0.90,true_sphericity=0.80"


def redraw(seed: int) -> bytes:
    """A stone as the studio sends it: its mesh in 32-bit numbers, and the four descriptors."""
    stone = generate(Recipe(seed=seed), device="cpu")
    values = measure(stone, "four")
    mesh = stone.mesh.vertices.astype(np.float32).tobytes() + stone.mesh.faces.astype(np.int32).tobytes()
    return mesh + json.dumps(dict(values)).encode()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--sweep", action="store_true", help="15 parameters x 11 points x 30 seeds as well: minutes")
    options = parser.parse_args()
    target = parse_target(TARGET)
    table = Table("what", "seconds", "aim")
    redraw(0)
    library = shipped_library()
    first = seconds(lambda: by_search(target, library, refine=False))
    table.add_row(f"a first answer from {len(library)} stones, judged on ten more", f"{first:.1f}", "10")
    refined = seconds(lambda: by_search(target, library))
    table.add_row("a refined answer", f"{refined:.1f}", "60")
    drawn = statistics.median(seconds(lambda seed=seed: redraw(seed)) for seed in range(1, 16))
    table.add_row("the studio's redraw at 20,000 triangles, without the network", f"{drawn:.3f}", "0.3")
    if options.sweep:
        folder = Path(tempfile.mkdtemp())
        try:
            plan = OneAtATime(seeds=30)
            swept = seconds(lambda: list(build(folder / "oat", plan, Measures(("four",)), source="oat", device="cpu")))
            table.add_row(f"one parameter at a time, {plan.count} stones", f"{swept:.0f}", "360")
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
