"""The command `lithoform`: generate, check, reproduce.

Results go to standard output, progress and errors to standard error.  Exit status: 0 done; 1 an unsound mesh
was found by `check`; 2 a wrong request or a failure, said in one sentence; 130 interrupted.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, CycloptsError, Parameter

from lithoform import __version__
from lithoform.errors import FileFormatError, LithoformError, MeshError, OutputError, RecipeError

if TYPE_CHECKING:
    from lithoform.planning import Plan

__all__ = ["app", "main"]

MAX_PICTURED = 60

app = App(
    name="lithoform",
    help="Simulation-ready virtual rock particles: generate, check and picture them.",
    version=__version__,
    help_format="markdown",
)

Flag = Annotated[bool, Parameter(negative="")]


@app.command
def generate(
    out: Path = Path("particles"),
    *,
    count: int | None = None,
    seed: int | None = None,
    class_: Annotated[str | None, Parameter(name="--class")] = None,
    preset: str | None = None,
    recipe: Path | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set", negative="")] = None,
    size: str | None = None,
    unit: str | None = None,
    triangles: int | None = None,
    format: str | None = None,
    device: str = "auto",
    picture: Flag = False,
    overwrite: Flag = False,
    resume: Flag = False,
    json_: Annotated[bool, Parameter(name="--json", negative="")] = False,
    debug: Flag = False,
) -> int:
    """Generate particles: a mesh and a JSON sidecar each, and a table of all.

    Writes OUT/000001.stl, OUT/000001.json, ... and OUT/particles.parquet; with --picture also OUT/gallery.png.

    **Example:** `lithoform generate stones --count 12 --class mixed --seed 1 --picture`

    **Example:** `lithoform generate slabs --count 5 --size 40,30,10 --set k=0.2 --set s=1.8 --format ply`

    **Example:** `lithoform generate again --recipe stones/000001.json` makes the same bytes again.

    Parameters
    ----------
    out
        Folder for the results; made if it does not exist.
    count
        Number of particles [default: 1].
    seed
        Run seed, 0 to 2^64 - 1; each particle has its own seed derived from it and its number [default:
        0, or the recipe's own].
    class_
        Zingg class in which the dimensions are drawn: cube, plate, column, blade, or mixed (the four in turn).
    preset
        benchmark (Table 1 of the paper) or database (its setting for scanned stones) [default: database].
    recipe
        TOML recipe, or the sidecar of a particle; without --seed and --count its very particle is made again.
    set_
        NAME=VALUE: a parameter by its symbol in Table 1 (k, s, s_w, eta, delta, O, lambda, g, alpha, beta,
        gamma, kappa, A_L, f_L, a, p0, rho, L, W, H) or by its full name; may be repeated.
    size
        L,W,H in the unit of --unit, from the largest to the smallest.
    unit
        Unit of lengths given and of the files: m, cm, mm, um or in [default: mm]. (glb files are in metres.)
    triangles
        Number of triangles, 8 n^2 or 20 n^2 [default: 20000].
    format
        stl, ply, obj, glb or 3mf [default: stl].
    device
        auto, cpu or cuda.
    picture
        Draw OUT/gallery.png as well.
    overwrite
        Replace the run that OUT holds.
    resume
        Finish an interrupted run: the same command with this added.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform import production
    from lithoform.planning import plan_run
    from lithoform.progress import track
    from lithoform.warp_runtime import resolve_device

    started = time.perf_counter()
    if overwrite and resume:
        raise OutputError("--overwrite starts anew and --resume goes on; give one of them.")
    plan = plan_run(
        count=count, seed=seed, shape_class=class_, preset=preset, recipe=recipe, settings=set_ or [],
        size=size, unit=unit, triangles=triangles, format=format,
    )  # fmt: skip
    # What can be refused is refused before OUT is touched.
    resolve_device(device)
    if picture:
        from lithoform.rendering import require_pictures

        require_pictures()
    production.open_run(out, plan, overwrite=overwrite, resume=resume)
    numbers = production.unfinished(out, plan) if resume else list(range(1, plan.count + 1))
    done = 0
    try:
        for _ in track(production.produce(out, plan, numbers, device=device), total=len(numbers), what="particles"):
            done += 1
    except KeyboardInterrupt:
        # Work in flight was finished after the last count.
        already = plan.count - len(numbers) + done
        print(
            f"lithoform: interrupted with at least {already} of {plan.count} particles; add --resume to finish it.",
            file=sys.stderr,
        )
        return 130
    table = production.write_table(out, plan)
    drawn = _draw_gallery(out, plan) if picture else None
    _report_run(out, plan, table, drawn, done, time.perf_counter() - started, as_json=json_)
    return 0


@app.command
def check(
    files: Annotated[list[Path], Parameter(negative="")],
    /,
    *,
    json_: Annotated[bool, Parameter(name="--json", negative="")] = False,
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
            print(_check_line(result))
    if json_:
        print(json.dumps(results, indent=2))
    if any(result.get("sound") is False for result in results):
        return 1
    return 2 if any("error" in result for result in results) else 0


@app.command
def reproduce(
    what: str,
    /,
    *,
    out: Path = Path("figures"),
    seed: int | None = None,
    triangles: int = 20_000,
    device: str = "auto",
    json_: Annotated[bool, Parameter(name="--json", negative="")] = False,
    debug: Flag = False,
) -> int:
    """Draw a figure of the paper: fig2, the gallery of one-parameter variations at one seed and one view.

    **Example:** `lithoform reproduce fig2 --out figures`

    Parameters
    ----------
    what
        fig2.
    out
        Folder for the picture.
    seed
        Seed of the stone [default: the one of the documentation].
    triangles
        Number of triangles of each stone.
    device
        auto, cpu or cuda.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform import reproduce as figures

    if what not in figures.FIGURES:
        raise RecipeError(f"expected one of {', '.join(figures.FIGURES)}; got {what!r}.")
    path = figures.FIGURES[what](out, seed=seed, triangles=triangles, device=device)
    print(json.dumps({"figure": what, "file": str(path)}) if json_ else f"{what}: {path}")
    return 0


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command and exit with its status.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        status = app(_repeat_set(given), exit_on_error=False, print_error=False, result_action="return_value")
    except KeyboardInterrupt:
        print("lithoform: interrupted.", file=sys.stderr)
        status = 130
    except BrokenPipeError:
        # The reader of our output has gone (`lithoform check ... | head`): no fault of ours, nothing to say.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 141
    except (LithoformError, CycloptsError) as error:
        if "--debug" in given:
            raise
        print(f"lithoform: {_one_line(error)}", file=sys.stderr)
        status = 2
    except Exception as error:
        if "--debug" in given:
            raise
        # A fault of the program, not of the request; still no traceback in a user's terminal.
        kind = type(error).__name__
        print(f"lithoform: unexpected fault ({kind}: {_one_line(error)}); --debug shows where.", file=sys.stderr)
        status = 2

    sys.exit(status or 0)


def _repeat_set(arguments: list[str]) -> list[str]:
    """Let one --set take several NAME=VALUE: each further one gets a --set of its own."""
    out: list[str] = []
    in_set = False
    for word in arguments:
        if in_set and out[-1] != "--set" and "=" in word and not word.startswith("-"):
            out.append("--set")
        elif word == "--set":
            in_set = True
        elif in_set and out[-1] != "--set":
            in_set = False
        out.append(word)
    return out


def _one_line(error: Exception) -> str:
    text = str(error) or type(error).__name__
    return " ".join(line.strip() for line in text.splitlines() if line.strip())


def _draw_gallery(out: Path, plan: Plan) -> Path:
    from lithoform.figures import gallery
    from lithoform.mesh_io import UNITS, read_mesh
    from lithoform.production import PICTURE_FILE
    from lithoform.sidecar import read_sidecar, sidecar_path

    meshes, captions = [], []
    for number in range(1, min(plan.count, MAX_PICTURED) + 1):
        path = out / plan.mesh_file(number)
        sidecar = read_sidecar(sidecar_path(path))
        recipe = sidecar["recipe"]
        size = " x ".join(f"{recipe[n] * UNITS[plan.unit]:.3g}" for n in ("length", "width", "height"))
        meshes.append(read_mesh(path, unit=plan.unit))
        captions.append(f"{number:06d}  {sidecar['class']}\n{size} {plan.unit}")
    target = out / PICTURE_FILE
    gallery(meshes, captions, target)
    return target


def _report_run(
    out: Path, plan: Plan, table: Path, drawn: Path | None, done: int, seconds: float, *, as_json: bool
) -> None:
    if as_json:
        answer = {
            "out": str(out),
            "count": plan.count,
            "generated": done,
            "files": [plan.mesh_file(n) for n in range(1, plan.count + 1)],
            "table": str(table),
            "picture": None if drawn is None else str(drawn),
            "seconds": round(seconds, 3),
        }
        print(json.dumps(answer, indent=2))
        return
    kept = f" ({plan.count - done} were there already)" if done < plan.count else ""
    noun = "particle" if plan.count == 1 else "particles"
    print(f"{plan.count} {noun} in {out.resolve()}{kept}, every mesh checked when it was made, {seconds:.1f} s")
    last = "" if plan.count == 1 else f" ... {plan.mesh_file(plan.count)}"
    print(f"  meshes   {plan.mesh_file(1)}{last}  ({plan.format}, {plan.unit}), with a .json sidecar each")
    print(f"  table    {table.name}")
    if drawn is not None:
        some = f"  (the first {MAX_PICTURED})" if plan.count > MAX_PICTURED else ""
        print(f"  picture  {drawn.name}{some}")


def _mesh_files(paths: list[Path]) -> list[Path]:
    from lithoform.mesh_io import FORMATS

    out: list[Path] = []
    for path in paths:
        if path.is_dir():
            found = sorted(p for p in path.iterdir() if p.suffix.lower()[1:] in FORMATS)
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
        return {"file": str(path), "error": _one_line(error).removeprefix(f"{path}: ")}
    return {"file": str(path), "triangles": len(mesh.faces), **report.as_dict()}


def _check_line(result: dict[str, Any]) -> str:
    if "error" in result:
        return f"{result['file']}: cannot be read: {result['error']}"
    if result["sound"]:
        return f"{result['file']}: sound, {result['triangles']} triangles ({result['certificate']})"
    return f"{result['file']}: UNSOUND, {'; '.join(result['problems'])}"
