"""The table of descriptors and what measures by it: conventions, invariances, sharing, errors."""

from __future__ import annotations

import math

import bodies
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform import database_recipe, fit_to_box, generate, particle_seed
from lithoform.descriptors import body as body_module
from lithoform.descriptors.body import Body
from lithoform.descriptors.measuring import Measurement, measure, measure_many, resolve_names
from lithoform.descriptors.table import DESCRIPTORS, FOUR, STANDARD
from lithoform.errors import MeshError
from lithoform.mesh import Mesh

TRIANGLES = 5_000


@pytest.fixture(scope="module")
def stones():
    classes = ("cube", "plate", "column", "blade")
    return [
        generate(database_recipe(c, seed=particle_seed(5, i), triangles=TRIANGLES), device="cpu")
        for i, c in enumerate(classes)
    ]


def test_every_row_of_the_table_is_complete():
    for name, row in DESCRIPTORS.items():
        assert row.name == name
        assert row.name.isidentifier()
        assert row.definition
        assert row.citation
        assert row.low < row.high
        assert row.power in (0, 1, 2, 3, 5)
        assert set(row.conventions) <= {"box", "scale"}
    assert set(FOUR) <= set(STANDARD)
    assert len({row.symbol for row in DESCRIPTORS.values()}) == len(DESCRIPTORS)


def test_values_of_a_sphere_are_its_closed_forms():
    values = measure(bodies.sphere(20_000, radius=2.0), "all")
    tolerance = 2e-3  # 20,000 flat triangles: the volume lacks 1 - O(h^2)
    for name, truth in {
        "volume": 32 * math.pi / 3, "surface_area": 16 * math.pi, "equivalent_diameter": 4.0, "inscribed_radius": 2.0,
        "true_sphericity": 1.0, "solidity": 1.0, "boxiness": math.pi / 6, "roundness": 1.0, "length": 4.0,
        "thickness": 4.0, "elongation": 1.0, "flatness": 1.0, "surface_convexity": 1.0, "minimum_box_boxiness":
        math.pi / 6, "caliper_length": 4.0, "caliper_width": 4.0, "minimum_width": 4.0, "sieve_size": 4.0,
        "inertia_1": 8 * math.pi / 15 * 32, "inertia_3": 8 * math.pi / 15 * 32, "krumbein_sphericity": 1.0,
    }.items():  # fmt: skip
        assert values[name] == pytest.approx(truth, rel=tolerance), name
    assert values["zingg_class"] == "cube"
    assert values["corner_fraction"] == 0.0


def test_values_of_a_box_are_its_closed_forms():
    a, b, c = 0.05, 0.03, 0.02
    values = measure(bodies.box((a, b, c)), [n for n in DESCRIPTORS if n not in ("fractal_dimension", "zingg_class")])
    volume, area = a * b * c, 2 * (a * b + b * c + c * a)
    for name, truth in {
        "volume": volume, "surface_area": area, "boxiness": 1.0, "solidity": 1.0, "inscribed_radius": c / 2,
        "true_sphericity": math.pi ** (1 / 3) * (6 * volume) ** (2 / 3) / area, "length": a, "width": b,
        "thickness": c, "elongation": b / a, "flatness": c / b, "minimum_box_boxiness": 1.0,
        "caliper_length": math.sqrt(a * a + b * b + c * c), "minimum_width": c, "sieve_size": b,
        "hull_volume": volume, "hull_area": area, "inertia_1": volume * (b * b + c * c) / 12,
        "inertia_2": volume * (a * a + c * c) / 12, "inertia_3": volume * (a * a + b * b) / 12,
    }.items():  # fmt: skip
        assert values[name] == pytest.approx(truth, rel=1e-9), name


def test_values_of_stones_are_in_their_ranges(stones):
    for stone in stones:
        values = measure(stone, "all")
        assert list(values) == list(DESCRIPTORS)
        for name, value in values.items():
            row = DESCRIPTORS[name]
            assert isinstance(value, str) if name == "zingg_class" else type(value) is float, name
            if name != "zingg_class":
                assert row.low <= value <= row.high, name
                assert value > 0.0, name
        assert values["caliper_length"] >= values["minimum_box_length"] * (1 - 1e-12)
        assert values["minimum_box_boxiness"] >= values["boxiness"]
        assert 2 * values["inscribed_radius"] <= values["minimum_width"] <= values["sieve_size"]


def test_values_of_odd_bodies_are_in_their_ranges():
    # A U, whose hull has the larger surface: 3 x 4 outside, walls of 1, 1.5 deep.
    for mesh in (bodies.u_channel(), bodies.bowl(), bodies.tetrahedron(), bodies.subdivided_box((1, 1, 0.001), 8)):
        values = measure(mesh, [name for name in DESCRIPTORS if name != "zingg_class"])
        for name, value in values.items():
            assert DESCRIPTORS[name].low <= value <= DESCRIPTORS[name].high + 1e-12, name
    hull, surface = 2 * 12 + 14 * 1.5, 2 * 8 + 18 * 1.5
    convexity = measure(bodies.u_channel(), "surface_convexity")["surface_convexity"]
    assert convexity == pytest.approx(hull / surface, rel=1e-12)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), exponent=st.integers(-20, 20))
def test_every_measure_is_invariant_under_rotation_shift_and_scale(stones, seed, exponent):
    rng = np.random.default_rng(seed)
    mesh, scale = stones[seed % 4].mesh, 2.0**exponent
    shift = 10.0 * scale * np.ptp(mesh.vertices) * rng.uniform(-1, 1, 3)
    moved = mesh.with_vertices(scale * mesh.vertices @ bodies.random_rotation(rng).T + shift)
    names = [name for name in STANDARD if name != "zingg_class"]
    before, after = measure(mesh, names).scaled(scale), measure(moved, names)
    for name in names:
        # Roundness samples the surface on a grid in a frame of the body itself, which rounding turns a little.
        tolerance = {"roundness": 5e-3, "corner_fraction": 2e-2, "inscribed_radius": 1e-6}.get(name, 1e-9)
        assert after[name] == pytest.approx(before[name], rel=tolerance), name


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_order_of_vertices_and_faces_does_not_matter(stones, seed):
    rng = np.random.default_rng(seed)
    mesh = stones[seed % 4].mesh
    order, faces = rng.permutation(len(mesh.vertices)), rng.permutation(mesh.faces)
    shuffled = Mesh(mesh.vertices[order], np.argsort(order)[faces])
    before, after = measure(mesh, "four"), measure(shuffled, "four")
    for name in FOUR:
        assert after[name] == pytest.approx(before[name], rel=5e-3 if name == "roundness" else 1e-9), name


def test_solidity_does_not_change_with_the_box_of_a_body(stones):
    for stone in stones:
        squeezed = fit_to_box(stone.mesh, (0.03, 0.02, 0.004))
        assert measure(squeezed, "solidity")["solidity"] == pytest.approx(
            measure(stone, "solidity")["solidity"], rel=1e-9
        )


def test_conventions_are_told_with_the_values_that_depend_on_them(stones):
    told = measure(stones[0], ["boxiness", "roundness", "volume"], box="minimum", scale=0.3)
    assert told.conventions == {"boxiness": {"box": "minimum"}, "roundness": {"scale": 0.3}}
    assert told["boxiness"] == measure(stones[0], "minimum_box_boxiness")["minimum_box_boxiness"]
    assert told["roundness"] != measure(stones[0], "roundness")["roundness"]


def test_what_measures_share_is_computed_once(stones, monkeypatch):
    import lithoform.descriptors.hull as hull_module

    calls = []
    original = hull_module.convex_hull
    monkeypatch.setattr(hull_module, "convex_hull", lambda mesh: calls.append(1) or original(mesh))
    measure(stones[0], ["solidity", "hull_area", "minimum_width", "sieve_size", "surface_convexity"])
    assert len(calls) == 1


def test_a_coarse_mesh_is_said_to_be_too_coarse_for_its_roundness():
    coarse = measure(bodies.ellipsoid((3, 2, 1), 512), "roundness")
    assert any("coarse" in note for note in coarse.notes)
    assert measure(bodies.ellipsoid((3, 2, 1), 20_000), "roundness").notes == ()
    assert measure(bodies.ellipsoid((3, 2, 1), 512), "volume").notes == ()


def test_names_are_sets_or_single_ones_each_once():
    assert resolve_names(None) == STANDARD
    assert resolve_names("all") == tuple(DESCRIPTORS)
    assert resolve_names(["volume", "four", "roundness"]) == ("volume", *FOUR)
    with pytest.raises(MeshError, match="roundness"):
        resolve_names("roundnes")
    with pytest.raises(MeshError, match="at least one"):
        resolve_names([])


def test_many_are_measured_in_order_and_alike_whatever_the_threads(stones):
    one = [dict(m) for m in measure_many(stones, "four", threads=1)]
    three = [dict(m) for m in measure_many((s.mesh for s in stones), "four", threads=3)]
    assert one == three == [dict(measure(s, "four")) for s in stones]


def test_lengths_are_converted_by_their_power():
    values = Measurement({"volume": 2.0, "surface_area": 3.0, "length": 4.0, "solidity": 0.5, "zingg_class": "cube"})
    assert dict(values.scaled(1000.0)) == {
        "volume": 2e9, "surface_area": 3e6, "length": 4e3, "solidity": 0.5, "zingg_class": "cube",
    }  # fmt: skip


def test_objects_with_a_mesh_or_with_vertices_and_faces_will_do(stones):
    truth = measure(stones[0].mesh, "solidity")["solidity"]
    assert measure(stones[0], "solidity")["solidity"] == truth
    assert measure(stones[0].to_trimesh(), "solidity")["solidity"] == truth
    with pytest.raises(MeshError, match=r"expected a mesh.*got str"):
        measure("stone.stl", "volume")


def test_open_inside_out_and_flat_bodies_are_refused(stones):
    mesh = stones[0].mesh
    with pytest.raises(MeshError, match="closed surface"):
        measure(Mesh(mesh.vertices, mesh.faces[:-20]))
    with pytest.raises(MeshError, match="inside out"):
        measure(Mesh(mesh.vertices, mesh.faces[:, ::-1]))
    with pytest.raises(MeshError, match="volume"):
        measure(mesh.with_vertices(mesh.vertices * (1, 1, 0)))
    with pytest.raises(MeshError, match="box of principal, solid"):
        measure(mesh, box="smallest")
    with pytest.raises(MeshError, match="scale"):
        measure(mesh, scale=0.0)
    assert body_module._OPEN > 1e-12  # rounding of float32 files stays far below
    Body(mesh.with_vertices(mesh.vertices.astype(np.float32)))
