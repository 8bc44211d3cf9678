"""Sidecars: back to the bit, true to the file beside them, and plain errors for broken ones."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lithoform.errors import FileFormatError, LithoformError
from lithoform.mesh import Mesh
from lithoform.mesh_io import FORMATS, UNITS, file_unit, stored_vertices
from lithoform.parameters import Recipe
from lithoform.sidecar import build_sidecar, read_sidecar, sidecar_path, write_sidecar
from lithoform.topology import sphere


@pytest.fixture(scope="module")
def body() -> Mesh:
    """A body of about 25 mm with an odd shape, away from the origin."""
    ball = sphere("octahedral", 6)
    x, y, z = ball.vertices.T
    radius = 0.0123 * (1 + 0.2 * np.sin(5 * x + 1) * np.cos(4 * y) + 0.1 * np.sin(9 * z))
    return ball.with_vertices(ball.vertices * radius[:, None] * [1.3, 1.0, 0.7] + [0.001, -0.002, 0.03])


def sidecar_of(body: Mesh, **changes: object) -> dict:
    arguments = {"recipe": Recipe(seed=2**64 - 1).as_dict(), "mesh": body, "mesh_file": "/far/000001.stl",
                 "file_sha256": "ab" * 32, "format": "stl", "unit": "mm", "extra": None}  # fmt: skip
    return build_sidecar(**(arguments | changes))


def test_a_sidecar_comes_back_to_the_bit(body, tmp_path):
    path = sidecar_path(tmp_path / "000001.stl")
    assert path == tmp_path / "000001.json"
    sidecar = sidecar_of(body, extra={"class": "crushed", "number": 1})
    write_sidecar(path, sidecar)
    back = read_sidecar(path)
    assert back == json.loads(json.dumps(sidecar))  # tuples become lists, nothing else changes
    assert list(back) == list(sidecar)
    assert back["seed"] == back["recipe"]["seed"] == 2**64 - 1
    assert Recipe(**back["recipe"]) == Recipe(seed=2**64 - 1)
    assert back["volume"] == body.mass_properties.volume * 1000.0**3
    assert back["content_sha256"] == body.content_hash
    assert (back["schema"], back["file"], back["format"], back["unit"]) == (1, "000001.stl", "stl", "mm")
    assert (back["triangles"], back["vertices"]) == (288, 146)
    assert (back["class"], back["number"]) == ("crushed", 1)
    text = path.read_text(encoding="utf-8")
    assert text.startswith('{\n  "lithoform": "')
    assert text.endswith("\n}\n")
    write_sidecar(path, back)
    assert path.read_text(encoding="utf-8") == text


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("name", FORMATS)
def test_a_sidecar_tells_what_the_file_holds(body, tmp_path, name, unit):
    """The properties are those of the stored coordinates, taken as they stand in the file."""
    sidecar = sidecar_of(body, format=name, unit=unit)
    held = file_unit(name, unit)
    mass = body.with_vertices(stored_vertices(body, name, unit)).mass_properties
    assert sidecar["unit"] == held
    assert sidecar["units"] == {"volume": f"{held}^3", "area": f"{held}^2", "centroid": held, "inertia": f"{held}^5"}
    assert sidecar["volume"] == pytest.approx(mass.volume, rel=1e-6)
    assert sidecar["area"] == pytest.approx(mass.area, rel=1e-6)
    assert sidecar["centroid"] == pytest.approx(mass.centroid, rel=1e-6, abs=1e-7 * UNITS[held])
    assert np.array(sidecar["inertia"]) == pytest.approx(mass.inertia, rel=1e-5, abs=1e-6 * np.abs(mass.inertia).max())


def test_the_sidecar_of_a_ball(tmp_path):
    ball = sphere("icosahedral", 24)
    sidecar = sidecar_of(ball.with_vertices(ball.vertices * 0.01 + [0.02, 0, 0]), unit="cm")
    assert sidecar["volume"] == pytest.approx(4 / 3 * np.pi, rel=3e-3)
    assert sidecar["area"] == pytest.approx(4 * np.pi, rel=3e-3)
    assert sidecar["centroid"] == pytest.approx([2, 0, 0], abs=1e-12)
    assert np.array(sidecar["inertia"]) == pytest.approx(np.eye(3) * 8 / 15 * np.pi, rel=5e-3, abs=1e-12)


def test_what_a_sidecar_refuses(body, tmp_path):
    with pytest.raises(FileFormatError, match="its own seed, unit"):
        sidecar_of(body, extra={"seed": 1, "unit": "m", "other": 2})
    with pytest.raises(FileFormatError, match="expected a mesh format"):
        sidecar_of(body, format="xyz")
    for value in (float("nan"), float("inf"), object(), np.float32(1)):
        with pytest.raises(FileFormatError, match="plain, finite"):
            write_sidecar(tmp_path / "a.json", sidecar_of(body, extra={"value": value}))
    assert list(tmp_path.iterdir()) == []


def test_what_is_not_a_sidecar(body, tmp_path):
    path = tmp_path / "a.json"
    good = sidecar_of(body)

    def refused(content: object) -> str:
        path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
        with pytest.raises(FileFormatError) as caught:
            read_sidecar(path)
        assert str(caught.value).startswith(f"{path}: ")
        return str(caught.value)

    for key in good:
        assert f"lacks {key}" in refused({k: v for k, v in good.items() if k != key})
    assert "schema 2 is newer than 1; update" in refused(good | {"schema": 2})
    assert "newer" in refused({"schema": 3})
    for schema in (0, "1", None, True, 1.5):
        assert "schema" in refused(good | {"schema": schema})
    for content in ([], 3, None, "text"):
        assert "lacks" in refused(content)
    text = json.dumps(good).encode()
    for content in (
        text[:-5],
        b"\xff\xfe",
        b"{",
        text.replace(b'"triangles": 288', b'"triangles": NaN'),
        b"[" * 100_000,
    ):
        assert "JSON" in refused(content)
    assert "is empty" in refused(b"")
    path.unlink()
    with pytest.raises(FileFormatError, match="there is no such file"):
        read_sidecar(path)
    assert issubclass(FileFormatError, LithoformError)
