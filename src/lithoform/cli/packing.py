"""`lithoform pack`."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import can_draw, plain_warnings, say

if TYPE_CHECKING:
    from lithoform.packing.run import Made

__all__ = ["pack"]


def pack(
    *sources: Annotated[Path, Parameter(negative="")],
    container: str,
    out: Path,
    count: Whole | None = None,
    seed: Whole = 0,
    unit: str = "mm",
    select: str | None = None,
    gravity: float = 9.81,
    stiffness_factor: float = 0.01,
    dt: float | None = None,
    until: float | None = None,
    device: str = "auto",
    threads: Whole | None = None,
    vtk: bool = True,
    resume: Flag = False,
    overwrite: Flag = False,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Let stones fall into a container, and measure how they pack.

    The stones are rigid blocks with the convex hulls of their meshes in contact. They are let down at random places in
    random attitudes, fall, and come to rest. OUT gets packing.json with all numbers, blocks.csv with the place of each
    stone, table.parquet with the way there, packing.png, and files for ParaView: vtk (the way there, hulls and
    contacts) and vtk_meshes (the end).

    Interrupted, the same command with --resume goes on.

    **Example:** `lithoform pack stones --container cylinder:150mm:200mm --count 300 --out packing`

    Parameters
    ----------
    sources
        Mesh files, folders of them (a run of lithoform generate), or databases.
    container
        cylinder:DIAMETER:HEIGHT or box:X:Y:HEIGHT, open at the top; lengths such as 150mm, 15cm, 6in.
    out
        Folder for the results.
    count
        Stones; they are taken several times where there are fewer [default: each once].
    seed
        Of the choice, the order, the places and the attitudes: the same seed gives the same blocks.csv.
    unit
        Unit of mesh files that do not tell theirs: m, cm, mm, um or in.
    select
        Which particles of a database: a condition in SQL, such as "class = 'cube'".
    gravity
        [m/s^2].
    stiffness_factor
        On Young's modulus of the paper's Table 10, above 0 and at most 1: 0.01 makes the steps ten times as long.
    dt
        Time step [s] [default: 0.06 of the Rayleigh time of the smallest stone].
    until
        End at the latest at this time [s] [default: when the stones are at rest].
    device
        auto, cpu or cuda.
    threads
        [default: the processors at hand]; the result does not depend on it.
    vtk
        Write files for ParaView.
    resume
        Go on with a packing that was stopped.
    overwrite
        Replace the packing that OUT holds.
    json_
        Print one JSON object, lengths in metres, instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.packing.request import Request
    from lithoform.packing.run import pack as run
    from lithoform.warp_runtime import resolve_device

    began = time.perf_counter()
    request = Request(
        sources=sources,
        container=container,
        count=count,
        seed=seed,
        unit=unit,
        select=select,
        gravity=gravity,
        stiffness_factor=stiffness_factor,
        dt=dt,
        until=until,
        vtk=vtk,
    )
    resolve_device(device)
    draws = can_draw()
    lines: list[str] = []

    def told(line: str) -> None:
        lines.append(line)
        if not json_:
            say(line)

    try:
        with plain_warnings():
            results = run(request, out, device=device, threads=threads, overwrite=overwrite, resume=resume,
                          progress=True, told=told, draw_picture=_picture if draws else None)  # fmt: skip
    except KeyboardInterrupt:
        option = "--resume in place of --overwrite" if overwrite else "--resume"
        print(f"lithoform: interrupted; the same command with {option} goes on with {out}.", file=sys.stderr)
        return 130
    if json_:
        say(json.dumps({"out": str(out), "notes": lines, **results}, indent=2))
        return 0
    _tell(results)
    say(f"\n{out}: packing.json, blocks.csv, table.parquet{', packing.png' if draws else ''}"
        f"{', vtk, vtk_meshes' if vtk else ''}; {time.perf_counter() - began:.1f} s")  # fmt: skip
    return 0


def _picture(made: Made) -> bytes:
    import numpy as np
    from scipy.spatial.transform import Rotation

    from lithoform.figures.gallery import png_bytes
    from lithoform.figures.packing import Bed, packing_figure

    model, state, packing = made.model, made.state, made.packing
    bed = Bed(
        meshes=[shape.mesh for shape in model.shapes if shape.mesh is not None],
        which=model.shape,
        turns=Rotation.from_quat(state.orientation).as_matrix() * model.scale[:, None, None],
        places=state.position,
        sides=made.container.sides,
        height=made.container.height,
        edges=packing.edges,
        profile=packing.profile,
        band=packing.band,
        time=np.array([row["time"] for row in made.rows]),
        kinetic=np.array([row["kinetic_share"] for row in made.rows]),
        title=f"{model.count} stones",
        lines=[
            f"in a {made.container.text()}",
            f"packing density {packing.packing_density:.3f}",
            f"coordination number {packing.coordination['mean']:.2f}",
        ],
    )
    return png_bytes(packing_figure(bed), colours=256)


def _tell(results: dict[str, Any]) -> None:
    low, high = (1e3 * x for x in results["packing_density_between_m"])
    rows = [
        ("packing density", results["packing_density"], f"between heights of {low:.1f} and {high:.1f} mm"),
        ("", results["total_density"], f"from the floor to the height of the bed, {1e3 * results['height_m']:.1f} mm"),
        ("coordination number", results["coordination_number"], "contacts with other stones"),
        ("", results["coordination_without_rattlers"], f"without rattlers, {results['rattlers']:.1%} of the stones"),
        ("", results["coordination_with_walls"], "with those with walls"),
        ("deepest overlap", results["deepest_overlap_over_radius"], "of the effective radius"),
    ]
    say("")
    for name, value, meaning in rows:
        say(f"{name:<20}{'-' if value is None else f'{value:.4f}':>7}  {meaning}")
    above = results["stones"] - results["below_the_rim"]
    if above:
        say(f"{above} of {results['stones']} stones reach above the rim: about {results['below_the_rim']} fit.")
    state = "at rest" if results["at_rest"] else "not yet at rest: give a later --until"
    say(f"{results['steps']:,} steps of {results['time_step_s']:.2e} s, {results['time_s']:.3f} s; {state}.")
