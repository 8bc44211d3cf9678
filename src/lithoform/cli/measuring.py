"""`lithoform measure` and `lithoform picture`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import say

if TYPE_CHECKING:
    from lithoform.survey import Row

_ON_SCREEN = ("roundness", "boxiness", "solidity", "true_sphericity", "volume", "surface_area", "length", "width",
              "thickness", "zingg_class")  # fmt: skip
"""Columns that fit a terminal; --json and --csv hold all that were measured."""


def measure(
    files: Annotated[list[Path], Parameter(negative="")],
    /,
    *,
    descriptors: Annotated[list[str] | None, Parameter(negative="", consume_multiple=True)] = None,
    unit: str = "mm",
    box: str = "principal",
    scale: float = 0.25,
    triangles: Whole = 20_000,
    csv: Path | None = None,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Measure the shape of particles, ours or scans: a row a particle.

    Scans are welded, oriented and repaired first, and every repair is told. A file that cannot be measured is told
    with its fault, and the others go on; the command then exits with 2.

    **Example:** `lithoform measure stones --csv stones.csv`

    **Example:** `lithoform measure scans/*.ply --unit m --descriptors four sieve_size --json`

    Parameters
    ----------
    files
        Mesh files (stl, ply, obj, off, gltf, glb, 3mf, vtp), NIST spherical-harmonic files (anm .dat), or folders.
    descriptors
        Names, or four, standard or all; separated by spaces or commas [default: standard].
    unit
        Unit of files that do not tell theirs, and of the results: m, cm, mm, um or in.
    box
        Box of boxiness and of length, width and thickness: along the axes of the surface (principal), of the solid
        (solid) or of the vertices (vertices), or of least volume (minimum).
    scale
        Scale of the roundness, times the radius of the inscribed sphere.
    triangles
        Triangles of the meshes made from spherical harmonics, 8 n^2 or 20 n^2.
    csv
        Write all values to this file.
    json_
        Print a list of JSON objects instead of a table.
    debug
        Show the traceback of an error.
    """
    from lithoform.atomic import atomic_write
    from lithoform.descriptors.measuring import resolve_names
    from lithoform.progress import track
    from lithoform.scans.reading import find_scans
    from lithoform.survey import rows_to_csv, survey

    asked = _words(descriptors) if descriptors is not None else None
    names = resolve_names(asked)
    paths = find_scans(files)
    stream = survey(paths, names, unit=unit, triangles=triangles, box=box, scale=scale)  # type: ignore[arg-type]
    rows = list(track(stream, total=len(paths), what="particles", enabled=len(paths) > 1))
    if csv is not None:
        atomic_write(csv, rows_to_csv(rows, names, {"unit": unit, "box": box, "roundness_scale": scale}))
    if json_:
        say(json.dumps([row.as_dict() for row in rows], indent=2))
    else:
        _print_table(rows, [name for name in names if asked is not None or name in _ON_SCREEN], unit=unit)
        if csv is not None:
            say(f"{len(rows)} rows: {csv}")
    return 2 if any(row.error for row in rows) else 0


def _print_table(rows: list[Row], names: list[str], *, unit: str) -> None:
    from lithoform.descriptors.table import DESCRIPTORS

    def cell(value: Any) -> str:
        return value if isinstance(value, str) else f"{value:.4g}"

    def head(name: str) -> str:
        power = DESCRIPTORS[name].power
        return name if not power else f"{name} [{unit}{'' if power == 1 else f'^{power}'}]"

    table = [["file", *map(head, names)]]
    table += [[str(r.file), *(cell(r.measurement[n]) for n in names)] for r in rows if r.measurement is not None]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for line in table if len(table) > 1 else []:
        aligned = [line[0].ljust(widths[0]), *(w.rjust(n) for w, n in zip(line[1:], widths[1:], strict=True))]
        say("  ".join(aligned).rstrip())
    for row in rows:
        for text in (*row.repairs, *(row.measurement.notes if row.measurement is not None else ())):
            say(f"{row.file}: {text}")
        if row.error:
            print(f"{row.file}: not measured: {row.error}", file=sys.stderr)


def picture(
    file: Path,
    /,
    *,
    out: Path,
    show: Annotated[list[str] | None, Parameter(negative="", consume_multiple=True)] = None,
    unit: str = "mm",
    box: str = "principal",
    scale: float = 0.25,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Draw one particle with its inscribed sphere, its box, its convex hull, its corners: Fig. 3 of the paper.

    **Example:** `lithoform picture stones/000001.stl --out stone.png --show inscribed,box`

    Parameters
    ----------
    file
        A mesh, or a NIST spherical-harmonic file.
    out
        PNG to write.
    show
        Panels: inscribed, box, hull, corners, volume (the ball of equal volume); separated by commas or spaces
        [default: all five].
    unit
        Unit of a file that does not tell its own, and of the lengths in the picture.
    box
        principal, solid, vertices or minimum.
    scale
        Scale of the roundness, times the radius of the inscribed sphere.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.atomic import atomic_write
    from lithoform.figures.gallery import png_bytes
    from lithoform.figures.shape import LAYERS
    from lithoform.portrait import portrait
    from lithoform.rendering import require_pictures
    from lithoform.scans.reading import read_scan

    require_pictures()
    layers = _words(show) or list(LAYERS)
    scan = read_scan(file, unit=unit)
    pixels, found = portrait(scan.mesh, show=layers, box=box, scale=scale)  # type: ignore[arg-type]
    atomic_write(out, png_bytes(pixels))
    if json_:
        say(
            json.dumps({"file": str(file), "picture": str(out), "show": layers, **found, "repairs": list(scan.repairs)})
        )
        return 0
    for text in (*scan.repairs, *found.notes):
        say(f"{file}: {text}")
    say(f"{out}: {', '.join(f'{name} {value:.3f}' for name, value in found.items())}")
    return 0


def _words(given: list[str] | None) -> list[str]:
    """Words separated by commas, by spaces, or given one an option."""
    return [word for text in given or [] for word in text.split(",") if word]
