"""`lithoform laboratory`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import say
from lithoform.errors import FileFormatError, MeshError

_READ = ("volume", "sieve_size", "minimum_width", "caliper_length", "caliper_width", "caliper_thickness")


def laboratory(
    *files: Path,
    unit: str = "mm",
    slots: str = "half",
    triangles: Whole = 20_000,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Test a sample of particles as a laboratory does: sieve curve, flakiness, shape index, flat and elongated shares.

    All particles count as one sample of one density. A file that cannot be measured is told, left out, and the command
    exits with 2.

    **Example:** `lithoform laboratory stones`

    Parameters
    ----------
    files
        Mesh files, NIST spherical-harmonic files, or folders, as for `measure`.
    unit
        Unit of files that do not tell theirs: m, cm, mm, um or in.
    slots
        Slot of the flakiness test: half (of each particle's sieve size) or fractions (as EN 933-3 prints it, particles
        of 4 to 100 mm).
    triangles
        Triangles of the meshes made from spherical harmonics.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    import numpy as np

    from lithoform import lab
    from lithoform.mesh_io import UNITS, known_key
    from lithoform.progress import track
    from lithoform.scans.reading import find_scans
    from lithoform.survey import survey

    if slots not in ("half", "fractions"):
        raise MeshError(f"expected slots of half or fractions; got {slots!r}.")
    if not files:
        raise FileFormatError("expected at least one file or folder, such as lithoform laboratory stones.")
    paths = find_scans(files)
    per_metre = UNITS[known_key("unit", unit, UNITS)]
    stream = survey(paths, _READ, unit=unit, triangles=triangles)
    rows = list(track(stream, total=len(paths), what="particles", enabled=len(paths) > 1))
    for row in rows:
        if row.error:
            print(f"{row.file}: not measured: {row.error}", file=sys.stderr)
    values = [row.measurement.scaled(1.0 / per_metre) for row in rows if row.measurement is not None]
    if not values:
        raise MeshError("expected at least one particle that can be measured, got none.")
    volumes, sizes, widths, long, wide, thick = (np.array([value[name] for value in values]) for name in _READ)
    # The sieves that the sample meets: from the largest that nothing passes to the smallest that everything does.
    first = max(int(np.searchsorted(lab.TEST_SIEVES, sizes.min())) - 1, 0)
    last = min(int(np.searchsorted(lab.TEST_SIEVES, sizes.max())) + 1, len(lab.TEST_SIEVES))
    openings = np.array(lab.TEST_SIEVES[first:last] or lab.TEST_SIEVES[-1:])
    passing = lab.sieve_curve(sizes, volumes, openings)
    shares: dict[str, lab.Share] = {
        "flakiness_index": lab.flakiness_index(sizes, widths, volumes, slots=slots),  # type: ignore[arg-type]
        "shape_index": lab.shape_index(long, widths, volumes),
    }
    for found in lab.flat_and_elongated(long, wide, thick, volumes):
        for kind in ("flat", "elongated", "flat_and_elongated"):
            shares[f"{kind}_{found.ratio:g}:1"] = getattr(found, kind)
    if json_:
        told: dict[str, Any] = {
            "particles": len(values),
            "sieves_mm": (1e3 * openings).tolist(),
            "passing_percent_by_mass": passing.tolist(),
            "slots": slots,
            **{name: {"by_count": share.by_count, "by_mass": share.by_mass} for name, share in shares.items()},
            "errors": {str(row.file): row.error for row in rows if row.error},
        }
        say(json.dumps(told, indent=2))
    else:
        say(f"{len(values)} particles, sieve size {1e3 * sizes.min():.4g} to {1e3 * sizes.max():.4g} mm")
        say(
            "passing, % by mass  "
            + "  ".join(f"{1e3 * o:g} mm: {p:.1f}" for o, p in zip(openings, passing, strict=True))
        )
        say(f"{'':28}by count  by mass  [%]")
        for name, share in shares.items():
            say(f"{name.replace('_', ' '):28}{share.by_count:8.1f}{share.by_mass:9.1f}")
    return 2 if any(row.error for row in rows) else 0
