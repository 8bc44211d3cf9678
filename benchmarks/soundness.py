"""10,000 random recipes over the whole of Table 7: every one sound, or refused before any work.

    python benchmarks/soundness.py [--count 10000] [--seed 2026]

Every particle is checked again, from its bare vertices and faces, after the rounding of an STL file as well.
"""

from __future__ import annotations

import argparse
import collections
import sys
import time
from pathlib import Path

import numpy as np
from rich.progress import track

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from table_7 import random_recipe

from lithoform import Particle, RecipeError, UnsoundMeshError, check, generate
from lithoform.mesh_io import stored_vertices
from lithoform.warp_runtime import default_threads

TRIANGLES = (2048, 5000, 5120, 20000, 20480, 51200)


def examine(number: int, seed: int) -> tuple[str, Particle | None, float]:
    rng = np.random.default_rng([seed, number])
    started = time.perf_counter()
    try:
        particle = generate(random_recipe(rng, int(rng.choice(TRIANGLES))), device="cpu")
    except RecipeError as error:
        reason = "its triangles cannot follow its twist" if "cannot follow" in str(error) else str(error)
        return f"refused before any work: {reason}", None, 0.0
    except UnsoundMeshError as error:
        print(error, file=sys.stderr)
        return "refused after work", None, time.perf_counter() - started
    seconds = time.perf_counter() - started
    mesh = particle.mesh
    if not check(mesh.with_vertices(mesh.vertices)).sound:
        return "UNSOUND", particle, seconds
    rounded = check(mesh.with_vertices(stored_vertices(mesh, "stl", "mm"))).sound
    return "sound" if rounded else "sound, but not after rounding to 32 bits", particle, seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=2026)
    options = parser.parse_args()

    from concurrent.futures import ThreadPoolExecutor

    outcomes: collections.Counter[str] = collections.Counter()
    rounds, shares, seconds, certificates, narrowed = [], [], [], collections.Counter(), 0
    with ThreadPoolExecutor(default_threads()) as pool:
        results = pool.map(lambda n: examine(n, options.seed), range(options.count))
        for outcome, particle, elapsed in track(results, total=options.count, description="recipes"):
            outcomes[outcome] += 1
            if particle is not None:
                rounds.append(particle.relaxation_rounds)
                shares.append(particle.relaxed_vertices / len(particle.mesh.vertices))
                certificates[particle.report.certificate] += 1
                narrowed += particle.flatten_band != particle.recipe.flatten_band
                seconds.append(elapsed)
    for outcome, count in outcomes.most_common():
        print(f"{count:7d}  {outcome}")
    took, share = np.array(rounds), np.array(shares)
    print(f"certified star-shaped: {certificates['star-shaped']}, by search: {certificates['search']}")
    print(f"relaxed after the twist: {np.mean(share > 0):.1%} of the particles, at most {took.max()} rounds;")
    print(f"  of those, share of vertices: median {np.median(share[share > 0]):.2%}, 95th percentile "
          f"{np.quantile(share[share > 0], 0.95):.1%}")  # fmt: skip
    print(f"band of the flattening narrowed: {narrowed}")
    print(f"seconds a particle: median {np.median(seconds):.3f}, longest {max(seconds):.2f}")


if __name__ == "__main__":
    main()
