"""`lithoform measure` and `lithoform picture`."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from lithoform.cli.arguments import Flag, Json, Whole, words
from lithoform.cli.output import opened, say, say_table

if TYPE_CHECKING:
    from lithoform.survey import Row

_ON_SCREEN = {
    "roundness": "roundness", "boxiness": "boxiness", "solidity": "solidity", "true_sphericity": "TS", "volume": "V",
    "length": "L", "width": "W", "thickness": "T", "zingg_class": "class",
}  # fmt: skip
"""Columns that fit a terminal of 100 columns, and their heads; --json and --csv hold all that were measured."""

_LEAST_NAME = 20
"""Columns that the name of a file keeps, however narrow the terminal is."""


def measure(
    *files: Annotated[Path, Parameter(negative="")],
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

    The table shows roundness, boxiness, 3D solidity, true sphericity TS, volume V, length L, width W and thickness T of
    the box, and Zingg's class; --csv and --json give all measures.

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
        About how many triangles the meshes made from spherical harmonics have.
    csv
        Write all values to this file.
    json_
        Print a list of JSON objects instead of a table.
    debug
        Show the traceback of an error.
    """
    from lithoform.descriptors.measuring import resolve_names
    from lithoform.errors import FileFormatError
    from lithoform.mesh_io import UNITS, known_key
    from lithoform.progress import track
    from lithoform.scans.reading import find_scans
    from lithoform.survey import rows_to_csv, survey

    asked = words(descriptors) if descriptors is not None else None
    if not files:
        given = "; every word after --descriptors is taken for the name of one" if asked else ""
        raise FileFormatError(f"expected at least one file or folder, such as lithoform measure stones{given}.")
    names, unit = resolve_names(asked), known_key("unit", unit, UNITS)
    paths = find_scans(files)
    stream = survey(paths, names, unit=unit, triangles=triangles, box=box, scale=scale)  # type: ignore[arg-type]
    with opened(csv) as table:
        rows = list(track(stream, total=len(paths), what="particles", enabled=len(paths) > 1))
        if table is not None:
            table.write_bytes(rows_to_csv(rows, names, {"unit": unit, "box": box, "roundness_scale": scale}))
    if json_:
        say(json.dumps([row.as_dict() for row in rows], indent=2))
    else:
        heads = {name: name for name in names} if asked is not None else _ON_SCREEN
        _print_table(rows, heads, unit=unit)
        _print_notes(rows)
        if csv is not None:
            say(f"{len(rows)} rows: {csv}")
    return 2 if any(row.error for row in rows) else 0


def _print_table(rows: list[Row], heads: dict[str, str], *, unit: str) -> None:
    from lithoform.descriptors.table import DESCRIPTORS

    def cell(value: Any) -> str:
        return value if isinstance(value, str) else f"{value:.4g}"

    def head(name: str) -> str:
        power = DESCRIPTORS[name].power
        return heads[name] if not power else f"{heads[name]} [{unit}{'' if power == 1 else f'^{power}'}]"

    table = [["file", *map(head, heads)]]
    table += [[str(r.file), *(cell(r.measurement[n]) for n in heads)] for r in rows if r.measurement is not None]
    if sys.stdout.isatty():
        others = sum(2 + max(map(len, column)) for column in list(zip(*table, strict=True))[1:])
        room = max(shutil.get_terminal_size((100, 24)).columns - others, _LEAST_NAME)
        for line in table:
            # Its end tells more of a file than its folders.
            line[0] = line[0] if len(line[0]) <= room else "..." + line[0][3 - room :]
    if len(table) > 1:
        say_table(table)


def _print_notes(rows: Sequence[Row]) -> None:
    """What there is to tell of each file; a note that many share, such as of too coarse a mesh, only once."""
    shared: dict[str, list[Path]] = {}
    for row in rows:
        for note in row.measurement.notes if row.measurement is not None else ():
            shared.setdefault(note, []).append(row.file)
        for text in row.repairs:
            say(f"{row.file}: {text}")
        if row.error:
            print(f"{row.file}: not measured: {row.error}", file=sys.stderr)
    for note, files in shared.items():
        say(f"{files[0]}{f' and {len(files) - 1} more' if len(files) > 1 else ''}: {note}")


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
        Unit of a file that does not tell its own: m, cm, mm, um or in. The picture has lengths in m, mm or um.
    box
        principal, solid, vertices or minimum.
    scale
        Scale of the roundness, times the radius of the inscribed sphere.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.figures.gallery import png_bytes
    from lithoform.figures.shape import LAYERS
    from lithoform.portrait import portrait
    from lithoform.rendering import require_pictures
    from lithoform.scans.reading import read_scan

    require_pictures()
    layers = words(show) or list(LAYERS)
    with opened(out) as drawing:
        scan = read_scan(file, unit=unit)
        pixels, found = portrait(scan.mesh, show=layers, box=box, scale=scale)  # type: ignore[arg-type]
        if drawing is not None:
            drawing.write_bytes(png_bytes(pixels))
    if json_:
        told = {"repairs": list(scan.repairs), "notes": list(found.notes)}
        say(json.dumps({"file": str(file), "picture": str(out), "show": layers, **found, **told}))
        return 0
    for text in (*scan.repairs, *found.notes):
        say(f"{file}: {text}")
    say(f"{out}: {', '.join(f'{name} {value:.3f}' for name, value in found.items())}")
    return 0
