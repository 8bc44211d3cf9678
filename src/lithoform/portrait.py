"""One stone measured and drawn: its inscribed sphere, box, hull, corners and ball of equal volume, as in Fig. 3."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from lithoform.descriptors.body import Body, BoxKind
from lithoform.descriptors.measuring import Measurement, measure_body
from lithoform.descriptors.roundness import corner_weights
from lithoform.descriptors.solids import Sphere
from lithoform.errors import MeshError
from lithoform.figures.shape import LAYERS, descriptor_label, shape_picture
from lithoform.parameters import suggest

__all__ = ["portrait"]

_SHOWN_BY = {
    "inscribed": "roundness", "box": "boxiness", "hull": "solidity", "corners": "roundness",
    "volume": "true_sphericity",
}  # fmt: skip


def portrait(
    mesh: Any,
    *,
    show: Sequence[str] = LAYERS,
    box: BoxKind = "principal",
    scale: float = 0.25,
    dpi: int = 300,
) -> tuple[np.ndarray, Measurement]:
    """Measure a stone and draw what its descriptors see.

    Parameters
    ----------
    mesh : Mesh or Particle
        Closed and outward [m].
    show : sequence of str
        Panels of "inscribed", "box", "hull", "corners", "volume", in order.
    box, scale
        As `measure`.
    dpi : int
        Pixels per inch: a panel is 46 mm wide.

    Returns
    -------
    pixels : numpy.ndarray, shape (height, width, 3), uint8
    measurement : Measurement
        The descriptors shown [m].

    Raises
    ------
    MeshError
        If a panel is unknown, or the mesh is open, inside out or flat.
    LithoformError
        If the extra "pictures" is not installed.
    """
    for name in show:
        if name not in LAYERS:
            raise MeshError(f"expected panels of {', '.join(LAYERS)}; got {name!r}.{suggest(name, LAYERS)}")
    body = Body(mesh, box=box, scale=scale)
    names = list(dict.fromkeys(_SHOWN_BY[name] for name in show))
    found = measure_body(body, names)
    labels = {name: descriptor_label(_SHOWN_BY[name], found[_SHOWN_BY[name]]) for name in show}
    results: dict[str, Any] = {}
    if "inscribed" in show:
        results["inscribed"] = body.inscribed
    if "box" in show:
        results["box"] = body.box
    if "hull" in show:
        results["hull"] = body.hull.mesh
    if "corners" in show:
        results["corner_weights"] = corner_weights(body.mesh, body.roundness)
    if "volume" in show:
        radius = (3.0 * body.mass.volume / (4.0 * np.pi)) ** (1 / 3)
        results["equal_volume"] = Sphere(body.mass.centroid, float(radius))
    return shape_picture(body.mesh, show=show, labels=labels, unit="m", dpi=dpi, **results), found
