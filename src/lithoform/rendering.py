"""One stone as a picture: a mesh goes in, pixels come out, drawn off screen by PyVista (VTK).

VTK is loaded where it is used, and told how to draw on a machine without a display.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import importlib
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.errors import LithoformError
from lithoform.mesh import Mesh

__all__ = [
    "STONE",
    "VIEW",
    "Placement",
    "Studio",
    "Surface",
    "Vector",
    "load_module",
    "render",
    "require_pictures",
    "to_polydata",
    "view_axes",
]

Vector = tuple[float, float, float]

VIEW: Final[Vector] = (0.75, -1.0, 0.65)
"""Direction from the stone to the eye; z is up."""

STONE: Final[Vector] = (0.79, 0.75, 0.69)
"""Colour of the stone, red, green and blue from 0 to 1: a warm grey, as of limestone."""

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
_DISTANCE: Final = 10.0  # from the middle to the eye; in parallel projection it touches nothing but clipping
_EDGE: Final = (0.16, 0.17, 0.20)  # colour of the triangles' edges


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
    with Studio(size, view, colour) as studio:
        return studio.picture(mesh, span)


def to_polydata(mesh: Mesh) -> Any:
    """The mesh as a `pyvista.PolyData`, with copies of its vertices and faces.

    Raises
    ------
    LithoformError
        If PyVista is not installed.
    """
    # Copies, since PyVista would share the arrays, which are read-only here.
    return load_module("pyvista").PolyData.from_regular_faces(mesh.vertices.copy(), mesh.faces.copy())


def require_pictures() -> None:
    """Make sure, before long work, that pictures can be drawn after it.

    Raises
    ------
    LithoformError
        If a package is missing or the machine cannot draw off screen; it says what to install.
    """
    for module in ("pyvista", "matplotlib.figure", "PIL.Image"):
        load_module(module)
    _find_opengl()


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh and how it is drawn.

    Attributes
    ----------
    mesh : Mesh
    colour : (float, float, float) or numpy.ndarray, shape (m, 3)
        Red, green and blue from 0 to 1: of the body, or of each face.
    faceting : float
        Weight of a face's own normal beside the smooth one: 0 for a smooth body, large for flat faces.
    cavity : float
        How much darker pits, and lighter crests, are drawn; 0 where the colours themselves are to be read.
    edge_width : float
        Width of the triangles' edges [pixels]; 0 draws none.
    """

    mesh: Mesh
    colour: Vector | np.ndarray = STONE
    faceting: float = _FACETING
    cavity: float = _CAVITY
    edge_width: float = 0.0


@dataclass(frozen=True, eq=False)
class Placement:
    """How the space of a mesh is moved and scaled before the camera, and where its points fall in the picture.

    Attributes
    ----------
    centre : numpy.ndarray, shape (3,)
        Point of the mesh that is moved to the origin [unit of the mesh].
    zoom : float
        Scale: the height of the picture shows a length of 2 after it.
    offsets : tuple of numpy.ndarray, each of shape (3,)
        Shifts after the scale, across the view.
    axes : (numpy.ndarray, numpy.ndarray)
        Unit vectors to the right and upwards in the picture, each of shape (3,).
    size : (int, int)
        Width and height of the picture [pixels].
    """

    centre: np.ndarray
    zoom: float
    offsets: tuple[np.ndarray, ...]
    axes: tuple[np.ndarray, np.ndarray]
    size: tuple[int, int]

    def move(self, points: np.ndarray) -> np.ndarray:
        """Points before the camera, shape (n, 3), from points of the mesh."""
        moved = (points - self.centre) * self.zoom
        for offset in self.offsets:
            moved -= offset
        return moved

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Places from the top left of the picture, shape (n, 2) [pixels], of points of the mesh, shape (n, 3)."""
        moved, half = self.move(points), 0.5 * self.size[1]
        x, y = ((moved * axis).sum(axis=1) for axis in self.axes)
        return np.stack([0.5 * self.size[0] + half * x, half - half * y], axis=1)

    @property
    def pixels_per_length(self) -> float:
        """Pixels that show one unit of length of the mesh."""
        return 0.5 * self.size[1] * self.zoom


class Studio:
    """One off-screen window with its lights and camera, for stone after stone.

    Every stone is moved and scaled to the same place before the same camera, so that neither its unit nor its
    place touches the picture.
    """

    def __init__(self, size: tuple[int, int], view: Vector, colour: Vector) -> None:
        if min(size) < 1:
            raise LithoformError(f"a picture needs at least 1 x 1 pixel; got {size}.")
        self._size, self._colour = size, np.asarray(colour, dtype=np.float64)
        self._right, self._up, self._towards = view_axes(view)
        pyvista = load_module("pyvista")
        _find_opengl()
        self._plotter = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="none")
        self._polydata = pyvista.PolyData.from_regular_faces
        self._shown = 0
        for position, strength, tone in _LIGHTS:
            light = pyvista.Light(position=position, intensity=strength, color=tone, light_type="camera light")
            self._plotter.add_light(light)
        self._plotter.camera_position = [tuple(_DISTANCE * self._towards), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
        self._plotter.enable_parallel_projection()
        self._plotter.enable_anti_aliasing("ssaa")

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *exception: object) -> None:
        self._plotter.close()

    def span(self, meshes: Sequence[Mesh]) -> float:
        """Length over the height of the picture with which every one of some meshes fits [their unit]."""
        axes = (self._right * self._size[1] / self._size[0], self._up)
        return _MARGIN * max(float(np.ptp(mesh.vertices @ axis)) for mesh in meshes for axis in axes)

    def placement(self, points: np.ndarray, span: float) -> Placement:
        """Placement that centres the outline of some points, shape (n, 3), and shows `span` over the height.

        Raises
        ------
        LithoformError
            If the span is not a positive length.
        """
        if not (math.isfinite(span) and span > 0.0):
            raise LithoformError(f"the height of a picture must show a positive length; got {span}.")
        centre, zoom, offsets = points.mean(axis=0), 2.0 / span, []
        moved = (points - centre) * zoom
        for axis in (self._right, self._up):
            along = moved @ axis
            offsets.append(0.5 * (along.min() + along.max()) * axis)
            moved -= offsets[-1]
        return Placement(centre, zoom, tuple(offsets), (self._right, self._up), self._size)

    def picture(self, mesh: Mesh, span: float | None = None, paper: str = "white") -> np.ndarray:
        """Pixels of one stone, shape (height, width, 3), uint8."""
        span = self.span([mesh]) if span is None else span
        # By the corners of the faces, so that a vertex that no face uses has no say.
        placement = self.placement(mesh.vertices[mesh.faces].reshape(-1, 3), span)
        return self.scene([Surface(mesh, self._colour)], placement, paper)

    def scene(self, surfaces: Sequence[Surface], placement: Placement, paper: str = "white") -> np.ndarray:
        """Pixels of some opaque bodies, the nearer before the farther, shape (height, width, 3), uint8."""
        depth = 1.0
        for i, surface in enumerate(surfaces):
            corners, normals, colours = _shaded_corners(surface)
            points = placement.move(corners)
            depth = max(depth, 1.0 + float(np.sqrt((points**2).sum(axis=1).max())))
            body = self._polydata(points, np.arange(len(points)).reshape(-1, 3))
            body.point_data["colours"] = colours
            body.point_data["Normals"] = normals
            body.point_data.active_normals_name = "Normals"
            material = {"ambient": 0.17, "diffuse": 0.95, "specular": 0.06, "specular_power": 12}
            # The name makes each body take the place of the one before.
            options = {"scalars": "colours", "rgb": True, "name": f"body {i}", "reset_camera": False, "render": False}
            look = self._plotter.add_mesh(body, **options, **material).prop
            look.interpolation = "Phong"
            if surface.edge_width > 0.0:
                look.show_edges, look.edge_color, look.line_width = True, _EDGE, surface.edge_width
        for i in range(len(surfaces), self._shown):
            self._plotter.remove_actor(f"body {i}", reset_camera=False, render=False)
        self._shown = len(surfaces)
        self._plotter.set_background(paper)
        self._plotter.camera.parallel_scale = 1.0
        distance = max(_DISTANCE, depth + 1.0)  # a magnified body reaches far towards the eye
        self._plotter.camera.position = tuple(distance * self._towards)
        self._plotter.camera.clipping_range = (distance - depth, distance + depth)
        self._plotter.render()  # a second screenshot alone would show the first stone again
        return np.ascontiguousarray(self._plotter.screenshot(return_img=True)[..., :3])


def view_axes(view: Vector) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors to the right and upwards in a picture and towards the eye, each of shape (3,).

    Raises
    ------
    LithoformError
        If the view is along z, which is up, or is no direction.
    """
    towards = np.asarray(view, dtype=np.float64)
    right = np.cross((0.0, 0.0, 1.0), towards)
    if not (np.isfinite(right).all() and right.any()):
        raise LithoformError(f"a picture needs a view that is not along z, which is up; got {view}.")
    towards = towards / np.linalg.norm(towards)
    right = right / np.linalg.norm(right)
    return right, np.cross(towards, right), towards


def _shaded_corners(surface: Surface) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, normals and colours (uint8) of the three corners of every face, each of shape (3 m, 3)."""
    mesh, colour = surface.mesh, np.asarray(surface.colour, dtype=np.float64)
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
    light = np.clip(1.0 - surface.cavity * pit, 0.5, 1.2)
    tint = np.clip(light[faces][..., None] * colour.reshape(-1, 1, 3), 0.0, 1.0)
    normals = _unit(smooth[faces] + surface.faceting * _unit(areas)[:, None])
    shades = (255.0 * tint + 0.5).astype(np.uint8)
    return mesh.vertices[faces].reshape(-1, 3), normals.reshape(-1, 3), shades.reshape(-1, 3)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.sqrt((vectors**2).sum(axis=-1, keepdims=True))
    return vectors / np.where(length > 0.0, length, 1.0)


def load_module(module: str) -> Any:
    """A module of the extra ``pictures``, imported where it is used.

    Raises
    ------
    LithoformError
        If it cannot be imported; it says what to install.
    """
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
    opengl, logger = load_module("vtkmodules.vtkRenderingOpenGL2"), load_module("vtkmodules.vtkCommonCore").vtkLogger
    verbosity = logger.GetCurrentVerbosityCutoff()
    logger.SetStderrVerbosity(logger.VERBOSITY_OFF)  # VTK says in a screenful what it returns as 0
    try:
        window = opengl.vtkEGLRenderWindow()
        window.SetOffScreenRendering(True)
        return bool(window.SupportsOpenGL())
    finally:
        logger.SetStderrVerbosity(verbosity)
