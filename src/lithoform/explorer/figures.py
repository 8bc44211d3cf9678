"""Figures of the explorer as plain Plotly values: the cloud of designs, and distributions of populations."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from lithoform.descriptors.table import DESCRIPTORS, FOUR
from lithoform.explorer.design import MISMATCH
from lithoform.presets import SHAPE_CLASSES

if TYPE_CHECKING:
    from lithoform.explorer.design import DesignSpace
    from lithoform.inverse.targets import Target

__all__ = ["Sample", "cloud", "distributions", "encoded"]

_FONT: Final = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"
_MAX_BINS: Final = 60
_CURVE: Final = 400  # points of a distribution curve
_FAINT, _MANY = 28.0, 3000
_COLOUR_SHARE: Final = 0.9  # of the points have a colour of their own; the rest are as far as can be


@dataclass(frozen=True)
class _Look:
    ink: str
    grid: str
    panel: str
    accent: str
    pair: tuple[str, str]
    marks: tuple[str, str]  # target, baseline
    scale: str | list[list[Any]]  # a small E stands out from the paper, a large one is still seen


_LOOKS: Final = {
    "light": _Look(
        "#2b2a28", "#dedad2", "#ffffff", "#a8431c", ("#9a6a34", "#2f6f8f"), ("#c2187a", "#1f5f4a"), "Viridis"
    ),
    "dark": _Look(
        "#e6e2da",
        "#46433e",
        "#262422",
        "#ffb07c",
        ("#d6a465", "#72b7d6"),
        ("#ff6fc8", "#7fdcb8"),
        [[0.0, "#fde725"], [0.3, "#5ec962"], [0.6, "#2f9a96"], [1.0, "#5a6fa8"]],
    ),
}


@dataclass(frozen=True, eq=False)
class Sample:
    """Values of one source.

    Attributes
    ----------
    label : str
    values : numpy.ndarray, shape (n,)
    classes : numpy.ndarray of str, shape (n,)
    """

    label: str
    values: np.ndarray
    classes: np.ndarray


def encoded(values: np.ndarray) -> dict[str, str]:
    """An array as Plotly takes it in binary form: 32-bit numbers in base64, and the shape of a table."""
    told = {"dtype": "f4", "bdata": base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()}
    return told if values.ndim == 1 else {**told, "shape": ", ".join(map(str, values.shape))}


def cloud(
    space: DesignSpace, axes: Sequence[str], target: Target, indices: np.ndarray, best: np.ndarray, *, theme: str
) -> dict[str, Any]:
    """Points of a design space on three axes, coloured by E (Fig. 14).

    Parameters
    ----------
    space : DesignSpace
    axes : sequence of 3 str
        Quantities on x, y and z.
    target : Target
    indices : numpy.ndarray, shape (k,)
        Points that are shown.
    best : numpy.ndarray
        Points that are highlighted, best first.
    theme : {"light", "dark"}

    Returns
    -------
    dict
        "data" and "layout".  The first two traces are the points and the best, in the order of the indices.

    Raises
    ------
    LithoformError
        If a quantity is unknown.
    """
    look = _LOOKS[theme]
    mismatch = space.mismatch(target)
    tips = [*FOUR, MISMATCH, *(axis.name for axis in space.library.axes)]
    table = np.column_stack([np.arange(len(space)), *(space.column(name, mismatch) for name in tips)])
    columns = [space.column(name, mismatch) for name in axes]
    template = _tip(space, tips)

    def points(at: np.ndarray, name: str, marker: dict[str, Any]) -> dict[str, Any]:
        x, y, z = (encoded(column[at]) for column in columns)
        return {"type": "scatter3d", "mode": "markers", "name": name, "x": x, "y": y, "z": z, "marker": marker,
                "customdata": encoded(table[at]), "hovertemplate": template}  # fmt: skip

    colours = mismatch[indices]
    limit = float(np.quantile(colours, _COLOUR_SHARE)) if len(colours) else 1.0
    bar = {"title": {"text": "E", "side": "top"}, "thickness": 12, "len": 0.6, "x": 0.0, "xanchor": "left", "y": 0.5,
           "tickfont": {"size": 11}, "outlinewidth": 0}  # fmt: skip
    # So faint and small that what is marked within many points is seen through them.
    opacity = min(0.75, _FAINT / math.sqrt(max(len(colours), 1)))
    size = 3 if len(colours) < _MANY else 2
    marker = {"size": size, "opacity": opacity, "color": encoded(colours), "colorscale": look.scale, "cmin": 0.0,
              "cmax": max(limit, 1e-9), "colorbar": bar}  # fmt: skip
    ring = {"size": 7, "symbol": "circle-open", "color": look.accent, "line": {"width": 2, "color": look.accent}}
    data = [points(indices, "designs", marker), points(best, f"best {len(best)}", ring)]
    named = []
    for name, place, symbol, colour, aside in (
        ("target", _target_place(axes, target), "cross", look.marks[0], 42),
        ("baseline", _baseline_place(space, axes, target), "diamond", look.marks[1], -42),
    ):
        if place is not None:
            told = "".join(f"<br>{space.label(axis)}: {value:.4g}" for axis, value in zip(axes, place, strict=True))
            data.append({"type": "scatter3d", "mode": "markers", "name": name, "x": [place[0]], "y": [place[1]],
                         "z": [place[2]], "marker": {"size": 9, "symbol": symbol, "color": colour},
                         "hovertemplate": f"<b>{name}</b>{told}<extra></extra>"})  # fmt: skip
            # The points about a mark may hide it, but not its name.
            named.append({"x": place[0], "y": place[1], "z": place[2], "text": name, "ax": aside, "ay": -42,
                          "arrowhead": 0, "arrowwidth": 1, "arrowcolor": colour, "font": {"color": colour},
                          "bgcolor": look.panel, "opacity": 0.85})  # fmt: skip
    scene = {
        "aspectmode": "cube",
        "annotations": named,
        "camera": {"eye": {"x": 1.55, "y": -1.55, "z": 0.85}, "center": {"x": 0, "y": 0, "z": -0.12}},
    }
    for letter, name in zip("xyz", axes, strict=True):
        scene[f"{letter}axis"] = {"title": {"text": space.label(name)}, "gridcolor": look.grid, "color": look.ink,
                                  "showbackground": False, "zerolinecolor": look.grid}  # fmt: skip
    clear = "rgba(0,0,0,0)"
    legend = {"x": 1.0, "xanchor": "right", "y": 0.02, "yanchor": "bottom", "itemsizing": "constant", "bgcolor": clear}
    tools = {"orientation": "v", "bgcolor": clear, "color": look.ink, "activecolor": look.accent}
    layout = {**_layout(look), "scene": scene, "uirevision": "|".join(axes), "legend": legend, "modebar": tools,
              "margin": {"l": 0, "r": 0, "t": 0, "b": 0}}  # fmt: skip
    return {"data": data, "layout": layout}


def distributions(
    samples: Sequence[Sample], name: str, *, kind: str = "histogram", by_class: bool = False, unit: str = "",
    theme: str = "light",
) -> dict[str, Any]:  # fmt: skip
    """Histograms or cumulative curves of one descriptor in one or two sources, all together or class by class.

    Parameters
    ----------
    samples : sequence of Sample
        One or two.
    name : str
        The descriptor.
    kind : {"histogram", "cumulative"}
    by_class : bool
        A panel for each Zingg class that has particles.
    unit : str
        Unit of the values.
    theme : {"light", "dark"}

    Returns
    -------
    dict
        "data" and "layout".
    """
    look = _LOOKS[theme]
    pooled = np.concatenate([sample.values for sample in samples]) if samples else np.empty(0)
    panels = [c for c in SHAPE_CLASSES if any((s.classes == c).any() for s in samples)] if by_class else [""]
    panels = panels or [""]
    edges = _edges(pooled)
    columns = 2 if len(panels) > 1 else 1
    rows = math.ceil(len(panels) / columns)
    data: list[dict[str, Any]] = []
    layout = {**_layout(look), "barmode": "overlay", "bargap": 0.0, "margin": {"l": 56, "r": 12, "t": 24, "b": 44},
              "legend": {"orientation": "h", "x": 0.0, "y": 1.0, "yanchor": "bottom"}}  # fmt: skip
    title = f"{name.replace('_', ' ')} {DESCRIPTORS[name].symbol}" + (f" [{unit}]" if unit else "")
    for i, panel in enumerate(panels):
        row, column, key = i // columns, i % columns, "" if i == 0 else str(i + 1)
        for sample, colour in zip(samples, look.pair, strict=False):
            values = sample.values[sample.classes == panel] if panel else sample.values
            if len(values):
                curve = _bars(values, edges) if kind == "histogram" else _steps(values)
                style = ({"marker": {"color": colour, "line": {"width": 0}}, "opacity": 0.6} if kind == "histogram"
                         else {"line": {"color": colour, "width": 2, "shape": "hv"}})  # fmt: skip
                data.append({**curve, **style, "name": sample.label, "legendgroup": sample.label, "showlegend": i == 0,
                             "xaxis": f"x{key}", "yaxis": f"y{key}"})  # fmt: skip
        width, height = 1.0 / columns, 1.0 / rows
        axis = {"gridcolor": look.grid, "linecolor": look.grid, "zeroline": False, "color": look.ink}
        is_lowest = i + columns >= len(panels)
        layout[f"xaxis{key}"] = {**axis, "domain": [column * width + 0.04 * column, (column + 1) * width - 0.04],
                                 "anchor": f"y{key}", "range": [float(edges[0]), float(edges[-1])],
                                 "title": {"text": title if is_lowest else ""}}  # fmt: skip
        top = 1.0 - row * height
        layout[f"yaxis{key}"] = {**axis, "domain": [top - height + (0.1 if rows > 1 else 0.0), top],
                                 "anchor": f"x{key}", "rangemode": "tozero", "nticks": 5,
                                 "title": {"text": (f"{panel}<br>" if panel else "") + "share [%]"}}  # fmt: skip
    return {"data": data, "layout": layout}


def _layout(look: _Look) -> dict[str, Any]:
    return {"paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)",
            "font": {"family": _FONT, "size": 12, "color": look.ink},
            "hoverlabel": {"font": {"family": _FONT, "size": 11, "color": look.ink}, "bgcolor": look.panel,
                           "bordercolor": look.grid, "align": "left"}}  # fmt: skip


def _tip(space: DesignSpace, names: Sequence[str]) -> str:
    told = [f"{space.label(name)}: %{{customdata[{i}]:.4g}}" for i, name in enumerate(names, start=1)]
    # Two a line, so that the tip is no higher than the picture.
    first, rest = told[:5], told[5:]
    pairs = ["   ".join(rest[i : i + 2]) for i in range(0, len(rest), 2)]
    return "<b>design %{customdata[0]:.0f}</b><br>" + "<br>".join([*first, *pairs]) + "<extra></extra>"


def _target_place(axes: Sequence[str], target: Target) -> list[float] | None:
    """Where the target is; nowhere on the axis of a parameter, or of a descriptor that is not asked for."""
    places = {**dict(zip(FOUR, target.values, strict=True)), MISMATCH: 0.0}
    place = [places.get(name, math.nan) for name in axes]
    return place if all(map(math.isfinite, place)) else None


def _baseline_place(space: DesignSpace, axes: Sequence[str], target: Target) -> list[float]:
    from lithoform.inverse.targets import mismatch

    known = space.baseline
    away = float(mismatch(np.array([[known[name] for name in FOUR]]), target)[0])
    return [away if name == MISMATCH else known[name] for name in axes]


def _edges(values: np.ndarray) -> np.ndarray:
    """Equal bins of the width of Freedman and Diaconis, between 8 and 60, over all values."""
    if not len(values):
        return np.array([0.0, 1.0])
    low, high = float(values.min()), float(values.max())
    if not high > low:
        half = 0.5 * abs(low) or 0.5
        return np.linspace(low - half, low + half, 9)
    spread = float(np.subtract(*np.quantile(values, [0.75, 0.25])))
    width = 2.0 * spread / len(values) ** (1.0 / 3.0)
    count = math.ceil((high - low) / width) if width > 0.0 else _MAX_BINS
    return np.linspace(low, high, min(max(count, 8), _MAX_BINS) + 1)


def _bars(values: np.ndarray, edges: np.ndarray) -> dict[str, Any]:
    counts, _ = np.histogram(values, edges)
    middles, width = 0.5 * (edges[1:] + edges[:-1]), float(edges[1] - edges[0])
    return {"type": "bar", "x": encoded(middles), "y": encoded(100.0 * counts / len(values)), "width": width,
            "hovertemplate": "%{x:.4g}: %{y:.1f} %"}  # fmt: skip


def _steps(values: np.ndarray) -> dict[str, Any]:
    ordered = np.sort(values)
    # Of many particles so many steps that the eye sees no difference.
    at = np.unique(np.linspace(0, len(ordered) - 1, min(len(ordered), _CURVE)).round().astype(int))
    share = 100.0 * (at + 1) / len(ordered)
    return {"type": "scatter", "mode": "lines", "x": encoded(ordered[at]), "y": encoded(share),
            "hovertemplate": "%{y:.1f} % up to %{x:.4g}"}  # fmt: skip
