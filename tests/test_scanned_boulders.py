"""Seven scanned boulders against a table that an independent program measured."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from lithoform import measure, read_scan

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "collide"
IDS = [f"m_{letter}" for letter in "ABCDEFG"]

# Nine digits are printed, of a mesh in 32 bits.
DIGITS = 1e-6


@pytest.fixture(scope="module")
def table():
    if not DATA.is_dir():
        pytest.skip(f"the scanned boulders are not here: {DATA}")
    with (DATA / "descriptors.csv").open(encoding="utf-8") as file:
        return {row["id"].rpartition("/")[2]: row for row in csv.DictReader(file)}


@pytest.mark.parametrize("name", IDS)
def test_a_boulder_measures_what_its_table_says(table, name):
    scan = read_scan(DATA / f"{name}.ply", unit="m")
    assert scan.repairs == ()
    found = measure(scan.mesh, ["volume", "surface_area", "hull_volume", "solidity", "true_sphericity"])
    for ours, theirs in zip(found, ("V", "S", "V_hull", "solidity", "TS"), strict=True):
        assert found[ours] == pytest.approx(float(table[name][theirs]), rel=DIGITS), ours
    # Their elongation and flatness are of the solid's axes.
    by_solid = measure(scan.mesh, ["elongation", "flatness"], box="solid")
    assert by_solid["elongation"] == pytest.approx(float(table[name]["EI"]), rel=DIGITS)
    assert by_solid["flatness"] == pytest.approx(float(table[name]["FI"]), rel=DIGITS)


@pytest.mark.parametrize("name", IDS)
def test_boxiness_differs_by_how_the_surface_is_weighted(table, name):
    """The table puts the area of a triangle at its centroid; ours is the integral over the triangle."""
    mesh = read_scan(DATA / f"{name}.ply", unit="m").mesh
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    centroids = mesh.vertices[mesh.faces].mean(axis=1)
    offset = centroids - (area[:, None] * centroids).sum(axis=0) / area.sum()
    axes = np.linalg.eigh(np.einsum("f,fi,fj->ij", area, offset, offset))[1]
    lumped = mesh.volume / np.ptp(mesh.vertices @ axes, axis=0).prod()
    published = float(table[name]["B_surfPCA"])
    assert lumped == pytest.approx(published, rel=DIGITS)
    assert measure(mesh, "boxiness")["boxiness"] == pytest.approx(published, rel=1e-4)
