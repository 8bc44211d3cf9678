"""`lithoform laboratory` as a user and a script meet it."""

from __future__ import annotations

import json

import bodies
import pytest

from lithoform import write_mesh


@pytest.fixture
def sample(tmp_path):
    """A slab that is flaky, a rod that is non-cubical, two cubes: boxes, of which every answer is known."""
    folder = tmp_path / "sample"
    folder.mkdir()
    for name, size in {
        "slab": (0.030, 0.020, 0.004),
        "rod": (0.050, 0.010, 0.010),
        "cube_1": (0.010, 0.010, 0.010),
        "cube_2": (0.018, 0.018, 0.018),
    }.items():
        write_mesh(folder / f"{name}.stl", bodies.box(size))
    return folder


def test_indices_of_boxes_are_counted_by_hand(run, sample):
    status, out, err = run("laboratory", "sample", "--json")
    assert (status, err) == (0, "")
    told = json.loads(out)
    volumes = {"slab": 2400.0, "rod": 5000.0, "cube_1": 1000.0, "cube_2": 5832.0}
    total = sum(volumes.values())
    # The slab passes a square corner to corner, of (20 + 4) / sqrt 2 = 16.97 mm, and a slot of 4 mm: flaky.
    assert told["flakiness_index"]["by_count"] == pytest.approx(25.0)
    assert told["flakiness_index"]["by_mass"] == pytest.approx(100 * volumes["slab"] / total, rel=1e-6)
    # Longest distance over least thickness: slab 36.3 / 4, rod 52.0 / 10, cubes sqrt 3.
    assert told["shape_index"]["by_count"] == pytest.approx(50.0)
    assert told["flat_and_elongated_3:1"]["by_count"] == pytest.approx(50.0)
    sieves = {round(o, 3): p for o, p in zip(told["sieves_mm"], told["passing_percent_by_mass"], strict=True)}
    small = volumes["rod"] + volumes["cube_1"]
    assert sieves[16.0] == pytest.approx(100 * small / total, rel=1e-6)
    assert sieves[20.0] == pytest.approx(100.0)


def test_text_and_the_slots_of_the_standard(run, sample):
    status, out, _ = run("laboratory", "sample", "--slots", "fractions")
    assert status == 0
    assert out.startswith("4 particles, sieve size 10 to 18 mm")
    (line,) = (line for line in out.splitlines() if line.startswith("flakiness index"))
    assert line.split()[-2] == "25.0"


def test_what_cannot_be_measured_is_told_and_left_out(run, sample):
    (sample / "broken.stl").write_bytes(b"solid of nothing\n")
    status, out, err = run("laboratory", "sample", "--json")
    assert status == 2
    assert "broken.stl: not measured" in err
    assert json.loads(out)["particles"] == 4
    status, _, err = run("laboratory", "sample/broken.stl")
    assert status == 2
    assert "at least one particle" in err
    status, _, err = run("laboratory", "sample", "--slots", "third")
    assert status == 2
    assert "half or fractions" in err
