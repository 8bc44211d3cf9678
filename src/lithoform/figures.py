"""Pictures of stones: one stone, a contact sheet, the plate of one-parameter variations (Fig. 2).

Meshes come in, pixels and PNG files go out; nothing about a stone is computed anew.  Stones are drawn by
PyVista (VTK) off screen, pages are laid out by Matplotlib; both are loaded where they are used.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import importlib
import io
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from lithoform.atomic import atomic_write
from lithoform.errors import LithoformError
from lithoform.mesh import Mesh
from lithoform.parameters import PARAMETERS

__all__ = [
    "STONE",
    "VIEW",
    "Variation",
    "figure_2",
    "gallery",
    "png_bytes",
    "render",
    "require_pictures",
    "to_polydata",
]

Vector = tuple[float, float, float]

VIEW: Final[Vector] = (0.75, -1.0, 0.65)
"""Direction from the stone to the eye; z is up."""

STONE: Final[Vector] = (0.79, 0.75, 0.69)
"""Colour of the stone, red, green and blue from 0 to 1: a warm grey, as of limestone."""

# The paper's symbols as Matplotlib writes mathematics, by their form in ASCII; "size" is L, W and H together.
_MATHTEXT: Final = {
    "eta": r"\eta", "delta": r"\delta_i", "lambda": r"\lambda", "alpha": r"\alpha", "beta": r"\beta",
    "gamma": r"\gamma", "kappa": r"\kappa", "a": r"\mathbf{a}", "p0": r"\mathbf{p}_0", "rho": r"\rho",
    "n": r"\hat{\mathbf{n}}", "size": "[L,W,H]",
}  # fmt: skip
# Direction of each light seen from the camera (right, up, towards the eye), strength, colour.  The key light
# comes from far to the side, so that relief casts shade; the others keep the shaded side readable.
_LIGHTS: Final = (
    ((-1.6, 1.4, 0.35), 1.0, (1.0, 0.965, 0.91)),
    ((1.2, 0.4, 0.9), 0.34, (0.875, 0.91, 1.0)),
    ((0.0, -1.2, 0.5), 0.22, (1.0, 1.0, 1.0)),
)
_FACETING: Final = 0.7  # weight of a face's own normal beside the smooth one: crisp edges, no sawtooth
_CAVITY: Final = 0.8  # how much darker pits, and lighter crests, are drawn
_MARGIN: Final = 1.12  # room around the largest stone
_HIGHLIGHT: Final = "#faf0db"  # paper under the benchmark
_INK: Final = "#2b2a28"
_MILLIMETRES: Final = {"m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3}


@dataclass(frozen=True)
class Variation:
    """One row of stones that differ in one parameter.

    Attributes
    ----------
    symbol : str
        Symbol of the parameter in ASCII, or "size".
    stones : sequence of (str, Mesh)
        How the value is written, and the stone that it gives.
    benchmark : int or None
        Which of the stones is the benchmark.
    """

    symbol: str
    stones: Sequence[tuple[str, Mesh]]
    benchmark: int | None = None


def render(
    mesh: Mesh,
    *,
    size: tuple[int, int] = (480, 480),
    view: Vector = VIEW,
    colour: Vector = STONE,
    span: float | None = None,
) -> np.ndarray:
    """Picture of one stone on white, in parallel projection.

    Parameters
    ----------
    mesh : Mesh
    size : (int, int)
        Width and height [pixels].
    view : (float, float, float)
        Direction from the stone to the eye, not along z, which is up.
    colour : (float, float, float)
        Red, green and blue from 0 to 1.
    span : float, optional
        Length that the height of the picture shows [unit of the mesh]; by default the stone fills it.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
        On one machine, the same mesh gives the same pixels.

    Raises
    ------
    LithoformError
        If PyVista is not installed, the machine cannot draw off screen, or an argument makes no sense.
    """
    with _Studio(size, view, colour) as studio:
        return studio.picture(mesh, span)


def gallery(
    meshes: Sequence[Mesh],
    captions: Sequence[str],
    path: str | Path,
    *,
    columns: int | None = None,
    title: str | None = None,
    scale: Literal["common", "each"] = "common",
    unit: str = "m",
) -> Path:
    """Contact sheet of stones, a PNG file written whole or not at all.

    Parameters
    ----------
    meshes : sequence of Mesh
    captions : sequence of str
        One for each mesh; line breaks are kept.
    path : str or pathlib.Path
    columns : int, optional
        By default a sheet a little wider than high.
    title : str, optional
    scale : {"common", "each"}
        One scale for all, with a scale bar; or each stone as large as its cell.
    unit : {"m", "cm", "mm", "um"}
        Unit of the meshes, for the scale bar.

    Raises
    ------
    LithoformError
        If there is not one caption for each mesh, an option is unknown, or the stones cannot be drawn.
    OutputError
        If the file cannot be written.
    """
    if not meshes or len(captions) != len(meshes):
        raise LithoformError(f"a gallery needs one caption for each mesh; got {len(meshes)} meshes and "
                             f"{len(captions)} captions.")  # fmt: skip
    if scale not in ("common", "each") or unit not in _MILLIMETRES or (columns is not None and columns < 1):
        raise LithoformError(f"a gallery needs a scale of common or each, a unit of {', '.join(_MILLIMETRES)}, and at "
                             f"least 1 column; got {scale!r}, {unit!r} and {columns}.")  # fmt: skip
    columns = min(columns or math.ceil(math.sqrt(1.2 * len(meshes))), len(meshes))
    width, height = cell = (320, 260)
    pitch = height + 12 + 19 * max(caption.count("\n") + 1 for caption in captions)
    head, foot = (64 if title else 16), (56 if scale == "common" else 12)
    page = _Page(columns * width + 32, head + math.ceil(len(meshes) / columns) * pitch + foot)
    with _Studio(cell, VIEW, STONE) as studio:
        span = studio.span(meshes) if scale == "common" else None
        for i, (mesh, caption) in enumerate(zip(meshes, captions, strict=True)):
            left, top = 16 + (i % columns) * width, head + (i // columns) * pitch
            page.paste(studio.picture(mesh, span), left, top)
            page.text(left + width / 2, top + height + 2, caption, size=15, va="top")
    if title:
        page.text(24, 34, title, size=22, ha="left", weight="bold")
    if span is not None:
        millimetres = _round_length(0.6 * span * width / height * _MILLIMETRES[unit])
        bar = millimetres / _MILLIMETRES[unit] / span * height
        page.line([page.width - 28 - bar, page.width - 28], page.height - 24)
        page.text(page.width - 28 - bar / 2, page.height - 40, f"{millimetres:g} mm", size=15)
    return page.save(path)


def figure_2(
    rows: Sequence[Variation],
    path: str | Path,
    *,
    title: str | None = None,
    cell: tuple[int, int] = (300, 216),
    view: Vector = VIEW,
    symbols: bool = True,
) -> Path:
    """Plate of one-parameter variations as in Fig. 2, a PNG file written whole or not at all.

    Parameters
    ----------
    rows : sequence of Variation
        Drawn at one scale and one view, in two blocks side by side where they are many; the cell of the
        benchmark is tinted and its value bold.
    path : str or pathlib.Path
    title : str, optional
    cell : (int, int)
        Width and height of each picture [pixels]; the text is in proportion.
    view : (float, float, float)
        Direction from the stones to the eye.
    symbols : bool
        Write symbol and name of the parameter before each row.

    Raises
    ------
    LithoformError
        If a row has no stones, there are no rows, or the stones cannot be drawn.
    OutputError
        If the file cannot be written.
    """
    if not rows or not all(row.stones for row in rows):
        raise LithoformError("a plate of variations needs at least one row, and at least one stone in each row.")
    width, height = cell
    unit = height / 216.0
    blocks = 2 if len(rows) > 4 else 1
    deep = math.ceil(len(rows) / blocks)
    label, gap, edge = (round(x * unit) for x in (240 if symbols else 0, 46, 24 if symbols else 4))
    head, rule, gutter = (round(x * unit) for x in (124 if title else 24 if symbols else 4, 14, 64))
    across = label + width * max(len(row.stones) for row in rows)
    bottom = deep * (height + gap + rule) - rule + edge
    page = _Page(blocks * (across + gutter) - gutter + 2 * edge, head + bottom)
    if title:
        page.text(edge, head / 2, title, size=44 * unit, ha="left", weight="bold")
    with _Studio(cell, view, STONE) as studio:
        span = studio.span([mesh for row in rows for _, mesh in row.stones])
        for i, row in enumerate(rows):
            left = edge + (i // deep) * (across + gutter)
            top = head + (i % deep) * (height + gap + rule)
            if i % deep:
                page.line([left, left + across], top - rule / 2, width=1.0, colour="#d8d4cc")
            if symbols:
                middle, name = left + label / 2 - 10 * unit, _name(row.symbol)
                size = (36 if row.symbol == "size" else 50) * unit
                page.text(middle, top + 0.36 * height, f"${_MATHTEXT.get(row.symbol, row.symbol)}$", size=size)
                page.text(middle, top + 0.58 * height, name.replace(" ", "\n"), size=25 * unit, va="top")
            for j, (value, mesh) in enumerate(row.stones):
                x, marked = left + label + j * width, j == row.benchmark
                paper = _HIGHLIGHT if marked else "white"
                page.paste(studio.picture(mesh, span, paper), x, top, below=gap if marked else 0)
                weight = "bold" if marked else "normal"
                page.text(x + width / 2, top + height + 0.42 * gap, value, size=28 * unit, weight=weight)
    return page.save(path, colours=256 if symbols else 96)


def png_bytes(picture: np.ndarray, *, colours: int | None = None) -> bytes:
    """PNG file of a picture.

    Parameters
    ----------
    picture : numpy.ndarray, shape (height, width, 3), uint8
    colours : int, optional
        Write a palette of so many colours, 2 to 256: a smaller file.

    Raises
    ------
    LithoformError
        If Pillow, which comes with Matplotlib, is not installed.
    """
    image = _load("PIL.Image")
    pixels = image.fromarray(picture)
    if colours is not None:
        # No dithering: its noise costs more bytes than smoother gradients gain.
        pixels = pixels.quantize(colours, method=image.Quantize.MEDIANCUT, dither=image.Dither.NONE)
    stream = io.BytesIO()
    pixels.save(stream, format="PNG", optimize=colours is not None)
    return stream.getvalue()


def to_polydata(mesh: Mesh) -> Any:
    """The mesh as a `pyvista.PolyData`, with copies of its vertices and faces.

    Raises
    ------
    LithoformError
        If PyVista is not installed.
    """
    # Copies, since PyVista would share the arrays, which are read-only here.
    return _load("pyvista").PolyData.from_regular_faces(mesh.vertices.copy(), mesh.faces.copy())


def require_pictures() -> None:
    """Make sure, before long work, that pictures can be drawn after it.

    Raises
    ------
    LithoformError
        If a package is missing or the machine cannot draw off screen; it says what to install.
    """
    for module in ("pyvista", "matplotlib.figure", "PIL.Image"):
        _load(module)
    _find_opengl()


def _name(symbol: str) -> str:
    names = {p.symbol: p.name for p in PARAMETERS} | {"size": "target_size"}
    return names.get(symbol, symbol).replace("_", " ").replace("fbm", "FBM")


def _round_length(room: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above some length."""
    power = 10.0 ** math.floor(math.log10(room))
    return max(step * power for step in (1, 2, 5) if step * power <= room)


class _Page:
    """White paper on which pictures are pasted pixel for pixel; places in pixels from the top left."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self._pixels = np.full((height, width, 3), 255, dtype=np.uint8)
        self._figure = _load("matplotlib.figure").Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="none")

    def paste(self, picture: np.ndarray, left: int, top: int, below: int = 0) -> None:
        """Put a picture down, and the colour of its corner on so many rows of pixels below it."""
        high, wide = picture.shape[:2]
        self._pixels[top : top + high + below, left : left + wide] = picture[0, 0]
        self._pixels[top : top + high, left : left + wide] = picture

    def text(self, x: float, y: float, text: str, *, size: float, **options: Any) -> None:
        # Only whole formulas are parsed, so that a $ in a caption stays one.  72 points to 100 pixels.
        formula = text.startswith("$") and text.endswith("$")
        style = {"ha": "center", "va": "center", "color": _INK, "fontsize": 0.72 * size, "parse_math": formula}
        self._figure.text(x / self.width, 1 - y / self.height, text, math_fontfamily="stix", **(style | options))

    def line(self, x: list[float], y: float, *, width: float = 3.0, colour: str = _INK) -> None:
        ends = [v / self.width for v in x], [1 - y / self.height] * 2
        self._figure.add_artist(_load("matplotlib.lines").Line2D(*ends, color=colour, linewidth=0.72 * width))

    def save(self, path: str | Path, colours: int | None = None) -> Path:
        canvas = _load("matplotlib.backends.backend_agg").FigureCanvasAgg(self._figure)
        canvas.draw()
        # Only the ink goes through Matplotlib, which would resample a picture in float64: slow and large.
        layer = np.asarray(canvas.buffer_rgba())
        inked = layer[..., 3] > 0
        cover = layer[inked][:, 3:] / 255.0
        self._pixels[inked] = (layer[inked][:, :3] * cover + self._pixels[inked] * (1.0 - cover) + 0.5).astype(np.uint8)
        atomic_write(path, png_bytes(self._pixels, colours=colours))
        return Path(path)


class _Studio:
    """One off-screen window with its lights and camera, for stone after stone.

    Every stone is moved and scaled to the same place before the same camera, so that neither its unit nor its
    place touches the picture.
    """

    def __init__(self, size: tuple[int, int], view: Vector, colour: Vector) -> None:
        towards = np.asarray(view, dtype=np.float64)
        right = np.cross((0.0, 0.0, 1.0), towards)
        if min(size) < 1 or not (np.isfinite(right).all() and right.any()):
            raise LithoformError("a picture needs at least 1 x 1 pixel and a view that is not along z; "
                                 f"got {size} and {view}.")  # fmt: skip
        self._size, self._colour = size, np.asarray(colour, dtype=np.float64)
        towards = towards / np.linalg.norm(towards)
        self._right = right / np.linalg.norm(right)
        self._up = np.cross(towards, self._right)
        pyvista = _load("pyvista")
        _find_opengl()
        self._plotter = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="none")
        self._polydata = pyvista.PolyData.from_regular_faces
        for position, strength, tone in _LIGHTS:
            light = pyvista.Light(position=position, intensity=strength, color=tone, light_type="camera light")
            self._plotter.add_light(light)
        self._plotter.camera_position = [tuple(10.0 * towards), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
        self._plotter.enable_parallel_projection()
        self._plotter.enable_anti_aliasing("ssaa")

    def __enter__(self) -> _Studio:
        return self

    def __exit__(self, *exception: object) -> None:
        self._plotter.close()

    def span(self, meshes: Sequence[Mesh]) -> float:
        """Length over the height of the picture with which every one of some meshes fits [their unit]."""
        axes = (self._right * self._size[1] / self._size[0], self._up)
        return _MARGIN * max(float(np.ptp(mesh.vertices @ axis)) for mesh in meshes for axis in axes)

    def picture(self, mesh: Mesh, span: float | None = None, paper: str = "white") -> np.ndarray:
        """Pixels of one stone, shape (height, width, 3), uint8."""
        span = self.span([mesh]) if span is None else span
        if not (math.isfinite(span) and span > 0.0):
            raise LithoformError(f"the height of a picture must show a positive length; got {span}.")
        points, normals, colours = _shaded_corners(mesh, self._colour)
        points = (points - points.mean(axis=0)) * (2.0 / span)
        for axis in (self._right, self._up):  # centred by its outline in the picture
            along = points @ axis
            points -= 0.5 * (along.min() + along.max()) * axis
        stone = self._polydata(points, np.arange(len(points)).reshape(-1, 3))
        stone.point_data["colours"] = colours
        stone.point_data["Normals"] = normals
        stone.point_data.active_normals_name = "Normals"
        surface = {"ambient": 0.17, "diffuse": 0.95, "specular": 0.06, "specular_power": 12}
        # The name makes each stone take the place of the one before.
        options = {"scalars": "colours", "rgb": True, "name": "stone", "reset_camera": False, "render": False}
        self._plotter.add_mesh(stone, **options, **surface).prop.interpolation = "Phong"
        depth = 1.0 + float(np.sqrt((points**2).sum(axis=1).max()))
        self._plotter.set_background(paper)
        self._plotter.camera.parallel_scale = 1.0
        self._plotter.camera.clipping_range = (10.0 - depth, 10.0 + depth)
        self._plotter.render()  # a second screenshot alone would show the first stone again
        return np.ascontiguousarray(self._plotter.screenshot(return_img=True)[..., :3])


def _shaded_corners(mesh: Mesh, colour: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, normals and colours (uint8) of the three corners of every face, each of shape (3 m, 3)."""
    faces, areas = mesh.faces, mesh.area_vectors
    smooth = np.zeros_like(mesh.vertices)
    for corner in range(3):
        for axis in range(3):
            smooth[:, axis] += np.bincount(faces[:, corner], areas[:, axis], len(smooth))
    smooth = _unit(smooth)
    # Pits darker and crests lighter, as under an open sky: how far a vertex lies below its neighbours' mean.
    a, b = (mesh.vertices[ends] for ends in mesh.connectivity.edges.T)
    mean, step = mesh.connectivity.neighbour_mean, np.sqrt(((a - b) ** 2).sum(axis=1)).mean()
    pit = mean @ (mean @ (((mean @ mesh.vertices - mesh.vertices) * smooth).sum(axis=1) / step))
    tint = np.clip(np.clip(1.0 - _CAVITY * pit, 0.5, 1.2)[:, None] * colour, 0.0, 1.0)
    normals = _unit(smooth[faces] + _FACETING * _unit(areas)[:, None])
    shades = (255.0 * tint + 0.5).astype(np.uint8)
    return mesh.vertices[faces].reshape(-1, 3), normals.reshape(-1, 3), shades[faces].reshape(-1, 3)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.sqrt((vectors**2).sum(axis=-1, keepdims=True))
    return vectors / np.where(length > 0.0, length, 1.0)


def _load(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        missing = (error.name or module).split(".")[0]
        raise LithoformError(f'drawing stones needs {missing}, which cannot be imported: pip install "lithoform'
                             f'[pictures]" brings it ({error}).') from error  # fmt: skip


@functools.cache
def _find_opengl() -> None:
    """Point VTK to a way to draw off screen that this machine has, or say that there is none.

    On a machine without a display and X11's library, or without OpenGL, VTK's own choice ends the process
    with a segmentation fault (seen with 9.7), so that it is not left to choose there.
    """
    ours = sys.platform.startswith("linux") and not os.environ.get("VTK_DEFAULT_OPENGL_WINDOW")
    if not ours or (os.environ.get("DISPLAY") and _has_library("libX11.so.6")):
        return
    if _has_library("libEGL.so.1") and _egl_works():
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkEGLRenderWindow"
    elif _has_library("libOSMesa.so.8") or _has_library("libOSMesa.so"):
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkOSOpenGLRenderWindow"
    else:
        raise LithoformError(
            "drawing stones needs OpenGL, which this machine lacks; install Mesa (Debian and Ubuntu: apt-get "
            "install libegl1 libgl1-mesa-dri; Fedora: dnf install mesa-libEGL mesa-dri-drivers)."
        )


def _has_library(name: str) -> bool:
    with contextlib.suppress(OSError):
        return bool(ctypes.CDLL(name))
    return False


def _egl_works() -> bool:
    opengl, logger = _load("vtkmodules.vtkRenderingOpenGL2"), _load("vtkmodules.vtkCommonCore").vtkLogger
    verbosity = logger.GetCurrentVerbosityCutoff()
    logger.SetStderrVerbosity(logger.VERBOSITY_OFF)  # VTK says in a screenful what it returns as 0
    try:
        window = opengl.vtkEGLRenderWindow()
        window.SetOffScreenRendering(True)
        return bool(window.SupportsOpenGL())
    finally:
        logger.SetStderrVerbosity(verbosity)
