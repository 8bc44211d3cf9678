"""`lithoform check`."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from lithoform.cli.arguments import Flag, Json
from lithoform.cli.output import one_line, say
from lithoform.errors import FileFormatError, MeshError


def check(
    *files: Annotated[Path, Parameter(negative="")],
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Check meshes: closed, 2-manifold, outward, Euler characteristic 2, no zero-area or intersecting faces.

    Prints a line a file, with the count of every fault and the place of the first in the file's own numbers; exits
    with 1 if any is unsound, with 2 if one cannot be read.

    **Example:** `lithoform check stones/*.stl`

    Parameters
    ----------
    files
        Mesh files (stl, ply, obj, glb, 3mf), or folders of them.
    json_
        Print a list of JSON objects instead of lines.
    debug
        Show the traceback of an error.
    """
    from lithoform.progress import track

    paths = _mesh_files(files)
    results = []
    for path in track(paths, total=len(paths), what="files", enabled=len(paths) > 20):
        result = _check_file(path)
        results.append(result)
        if not json_:
            say(_check_line(result))
    if json_:
        say(json.dumps(results, indent=2))
    if any(result.get("sound") is False for result in results):
        return 1
    return 2 if any("error" in result for result in results) else 0


def _mesh_files(paths: Sequence[Path]) -> list[Path]:
    from lithoform.mesh_io import FORMATS

    out: list[Path] = []
    for path in paths:
        if os.path.isdir(path):  # noqa: PTH112 (Path.is_dir raises for a name too long)
            found = sorted(p for p in path.iterdir() if p.suffix.lower()[1:] in FORMATS and not p.is_dir())
            if not found:
                raise FileFormatError(f"the folder {path} holds no mesh files ({', '.join(FORMATS)}).")
            out += found
        else:
            out.append(path)
    if not out:
        raise FileFormatError("expected at least one mesh file or folder, such as lithoform check stones/*.stl.")
    return out


def _check_file(path: Path) -> dict[str, Any]:
    from lithoform.mesh_io import read_mesh
    from lithoform.soundness import check as check_mesh

    try:
        # Read as metres, the numbers stay those of the file, and so do the places.
        mesh = read_mesh(path, unit="m")
        report = check_mesh(mesh)
    except (FileFormatError, MeshError) as error:
        return {"file": str(path), "error": one_line(error).removeprefix(f"{path}: ")}
    return {"file": str(path), "triangles": len(mesh.faces), **report.as_dict()}


def _check_line(result: dict[str, Any]) -> str:
    if "error" in result:
        return f"{result['file']}: cannot be read: {result['error']}"
    if result["sound"]:
        return f"{result['file']}: sound, {result['triangles']} triangles ({result['certificate']})"
    return f"{result['file']}: UNSOUND, {'; '.join(result['problems'])}"
