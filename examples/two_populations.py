"""Two databases of forty stones, one at the paper's setting and one smoother: compared, queried, graded."""

import tempfile
from pathlib import Path

from lithoform.database.building import Measures, build
from lithoform.database.grading import grade, read_candidates
from lithoform.database.population import read_population
from lithoform.database.queries import query
from lithoform.database.store import Store
from lithoform.gradation.curves import find_gradation
from lithoform.planning import Plan
from lithoform.statistics.comparison import compare_populations

NAMES = ("roundness", "solidity")


def plan(**changes):
    return Plan(count=40, seed=1, preset="database", shape_class="mixed", base={"triangles": 5000, **changes})


with tempfile.TemporaryDirectory() as folder:
    rough, smooth = Path(folder) / "rough", Path(folder) / "smooth"
    measures = Measures((*NAMES, "sieve_size", "volume"))
    for place, wanted in ((rough, plan()), (smooth, plan(smoothing_iterations=20))):
        # Threads of this process; without `workers` it would be a process a core.
        numbers = list(build(place, wanted, measures, workers=0))
        assert sorted(numbers) == list(range(1, 41))

    # Called again it finds all there: a build that was stopped goes on in the same way.
    assert list(build(rough, plan(), measures, workers=0)) == list(range(1, 41))

    rows = query(rough, "select class, avg(roundness) as roundness from particles group by class order by class")
    for row in rows.to_pylist():
        print("{class:6s}  roundness {roundness:.3f}".format(**row))

    a, b = (read_population(place, NAMES) for place in (rough, smooth))
    found = compare_populations(a.values, b.values, NAMES, seed=0, permutations=500, bootstrap=500)
    for name, one in zip(NAMES, found.pooled.descriptors, strict=True):
        index = one.index("bhattacharyya")
        print(f"{name:9s}  BC {index.value:.3f}, by chance {index.floor_mean:.3f}, p {index.p:.3f}")
        assert index.p < 0.05  # smoothing is seen

    drawn = grade(read_candidates(Store(rough)), find_gradation("AC-13"), min_size=4.75e-3, mass=2.0, seed=0)
    print(f"{len(drawn)} stones, {drawn.mass:.3f} kg, at most {drawn.largest_difference:.1e} % off the curve")
    assert drawn.largest_difference < 1.0
