"""The command `lithoform`: generate, check, reproduce.

Results go to standard output, progress and errors to standard error.  Exit status: 0 done; 1 an unsound mesh
was found by `check`; 2 a wrong request or a failure, said in one sentence; 130 interrupted; 141 nobody reads on.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Parameter, Token

from lithoform import __version__
from lithoform.errors import FileFormatError, LithoformError, MeshError, OutputError, RecipeError

__all__ = ["app", "main"]

app = App(
    name="lithoform",
    help="""Simulation-ready virtual rock particles: generate, check and picture them.

**Example:** `lithoform generate stones --count 12 --picture`""",
    version=__version__,
    help_format="markdown",
)

Flag = Annotated[bool, Parameter(negative="")]


def _whole(_: Any, tokens: Sequence[Token]) -> int:
    """A whole number and nothing that would have to be rounded to one."""
    text = tokens[0].value
    if not re.fullmatch(r"[+-]?[0-9]+", text):
        raise ValueError(f"expected a whole number in digits; got {text!r}.")
    if len(text) > 40:
        raise ValueError(f"expected a whole number of at most 39 digits; got {len(text)}.")
    return int(text)


Whole = Annotated[int, Parameter(converter=_whole)]


@app.command
def generate(
    out: Path = Path("particles"),
    *,
    count: Whole | None = None,
    seed: Whole | None = None,
    class_: Annotated[str | None, Parameter(name="--class")] = None,
    preset: str | None = None,
    recipe: Path | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set", negative="")] = None,
    size: str | None = None,
    unit: str | None = None,
    triangles: Whole | None = None,
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
    from lithoform.run_report import draw_gallery, run_report
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
    with production.open_run(out, plan, overwrite=overwrite, resume=resume):
        numbers = production.unfinished(out, plan) if resume else range(1, plan.count + 1)
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
        relaxed = production.write_table(out, plan)
        drawn = draw_gallery(out, plan) if picture else None
    seconds = time.perf_counter() - started
    _say(run_report(out, plan, drawn=drawn, done=done, relaxed=relaxed, seconds=seconds, as_json=json_))
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
            _say(_check_line(result))
    if json_:
        _say(json.dumps(results, indent=2))
    if any(result.get("sound") is False for result in results):
        return 1
    return 2 if any("error" in result for result in results) else 0


@app.command
def reproduce(
    what: str,
    /,
    *,
    out: Path = Path("figures"),
    seed: Whole | None = None,
    triangles: Whole = 20_000,
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
    _say(json.dumps({"figure": what, "file": str(path)}) if json_ else f"{what}: {path}")
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
        _open_output()
        _require_size_in_one_word(given)
        status = app(_repeat_set(given), exit_on_error=False, print_error=False, result_action="return_value")
        _say("", end="")  # what the help has left in the buffer
    except KeyboardInterrupt:
        print("lithoform: interrupted.", file=sys.stderr)
        status = 130
    except (BrokenPipeError, SystemExit):
        # The reader of our output has gone (`lithoform check ... | head`): no fault of ours, nothing to say.
        # The page of --help ends with SystemExit then.
        _drop_output()
        status = 141
    except (LithoformError, CycloptsError) as error:
        if "--debug" in given:
            raise
        print(f"lithoform: {_one_line(error)}", file=sys.stderr)
        status = 2
    except Exception as error:
        if "--debug" in given:
            raise
        if isinstance(error, OSError) and {"--help", "-h", "--version"} & set(given):
            # These pages are printed by cyclopts, not by `_say`.
            _drop_output()
            print(f"lithoform: standard output cannot be written: {error.strerror or error}.", file=sys.stderr)
            sys.exit(2)
        # A fault of the program, not of the request; still no traceback in a user's terminal.
        kind = type(error).__name__
        print(f"lithoform: unexpected fault ({kind}: {_one_line(error)}); --debug shows where.", file=sys.stderr)
        status = 2

    sys.exit(status or 0)


def _open_output() -> None:
    """Let names be printed that the terminal cannot show; refuse to work for an output that is closed."""
    if sys.stdout is None:
        raise OutputError("standard output is closed; send it to a file, or to /dev/null.")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _say(text: str, *, end: str = "\n") -> None:
    """Print a result at once, so that an output that takes none is an error of the command."""
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        _drop_output()
        raise OutputError(f"standard output cannot be written: {error.strerror or error}.") from None


def _drop_output() -> None:
    """Send the rest of standard output nowhere: the interpreter flushes it once more when it ends."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _require_size_in_one_word(arguments: list[str]) -> None:
    """Refuse `--size 20 15 10` and `--size -20,15,10`, of which the second word and the minus mean something else."""
    for word, value, after in zip(arguments, arguments[1:], [*arguments[2:], ""], strict=False):
        is_split = value.count(",") != 2 and re.match(r"[-+.,]?[0-9]", after)
        if word == "--size" and (is_split or re.match(r"-[.0-9]", value)):
            got = f"{value} {after}" if is_split else value
            raise RecipeError(f"expected --size L,W,H, three lengths above 0 such as 20,15,10; got {got}.")


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


def _mesh_files(paths: list[Path]) -> list[Path]:
    from lithoform.mesh_io import FORMATS

    out: list[Path] = []
    for path in paths:
        if os.path.isdir(path):  # noqa: PTH112 (Path.is_dir raises for a name too long)
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
