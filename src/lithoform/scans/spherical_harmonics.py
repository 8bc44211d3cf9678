"""Stones given by spherical-harmonic coefficients, as NIST publishes them (``*-anm-*.dat``).

The surface is a radius over directions, r(theta, phi) = sum over n and m of a_nm Y_nm(theta, phi), with the
orthonormal complex harmonics Y_nm = (-1)^m sqrt((2n+1)/(4 pi) (n-m)!/(n+m)!) P_nm(cos theta) exp(i m phi), where
P_nm (without a sign) is the associated Legendre function, theta the angle from z and phi that from x (Garboczi
2002, eq. 3 to 5; the sign (-1)^m was checked against the extents in NIST's table: without it a stone comes out
turned by 180 degrees about z).  A radius is real, so that a_n,-m = (-1)^m conj(a_nm).  Lengths are millimetres.

References
----------
Garboczi, E. J. (2002). Three-dimensional mathematical analysis of particle shape using X-ray tomography and
spherical harmonics: application to aggregates used in concrete. Cem. Concr. Res. 32, 1621-1638.
Holmes, S. A. and Featherstone, W. E. (2002). A unified approach to the Clenshaw summation and the recursive
computation of very high degree and order normalised associated Legendre functions. J. Geod. 76, 279-299.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from lithoform.errors import FileFormatError, MeshError
from lithoform.mesh import Mesh
from lithoform.topology import sphere
from lithoform.warp_runtime import MODULE_OPTIONS, load, shared_array, wp

__all__ = [
    "TRIANGLES",
    "evaluate_radius",
    "is_coefficient_text",
    "is_geometry_table",
    "parse_coefficients",
    "read_coefficients",
    "read_geometry_table",
    "require_possible",
    "stone_of",
    "usable_degree",
]

wp.set_module_options(MODULE_OPTIONS)

TRIANGLES: Final = (8, 8_000_000)
"""Fewest and most triangles of a stone made from coefficients: an octahedron, and the most of a recipe."""

_SYMMETRY_TOLERANCE: Final = 1e-6
"""Of a_00: the files round to 1e-10 of a millimetre, and their stones measure above 0.1 mm."""


@wp.kernel(enable_backward=False)
def _radius_kernel(
    directions: wp.array(dtype=wp.vec3d),
    coefficients: wp.array2d(dtype=wp.vec2d),
    raising: wp.array2d(dtype=wp.float64),
    lowering: wp.array2d(dtype=wp.float64),
    sectoral: wp.array(dtype=wp.float64),
    radius: wp.array(dtype=wp.float64),
):
    """Sum over orders m, and over degrees n within each, of Re(a_nm q_nm(z) (x + i y)^m), m > 0 counted twice."""
    i = wp.tid()
    x = directions[i][0]
    y = directions[i][1]
    z = directions[i][2]
    degree = coefficients.shape[0] - 1
    real = wp.float64(1.0)
    imaginary = wp.float64(0.0)
    total = wp.float64(0.0)
    weight = wp.float64(1.0)
    for m in range(degree + 1):
        before = wp.float64(0.0)
        q = sectoral[m]
        summed = coefficients[m, m] * q
        for n in range(m + 1, degree + 1):
            following = raising[n, m] * (z * q - lowering[n, m] * before)
            before = q
            q = following
            summed += coefficients[n, m] * q
        total += weight * (summed[0] * real - summed[1] * imaginary)
        following_real = real * x - imaginary * y
        imaginary = real * y + imaginary * x
        real = following_real
        weight = wp.float64(2.0)
    radius[i] = total


@lru_cache(maxsize=4)
def _recurrence(degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Factors of q_nm = raising (z q_n-1,m - lowering q_n-2,m), from q_mm = sectoral (Holmes and Featherstone)."""
    n, m = np.meshgrid(np.arange(degree + 1.0), np.arange(degree + 1.0), indexing="ij")
    inner = n > m
    raising, lowering = np.zeros(n.shape), np.zeros(n.shape)
    raising[inner] = np.sqrt((4.0 * n[inner] ** 2 - 1.0) / (n[inner] ** 2 - m[inner] ** 2))
    second = n > m + 1
    low = n[second] - 1.0
    lowering[second] = np.sqrt((low**2 - m[second] ** 2) / (4.0 * low**2 - 1.0))
    orders = np.arange(1.0, degree + 1.0)
    steps = -np.sqrt((2.0 * orders + 1.0) / (2.0 * orders))
    sectoral = np.cumprod(np.concatenate([[math.sqrt(1.0 / (4.0 * math.pi))], steps]))
    return raising, lowering, sectoral


def evaluate_radius(coefficients: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Radius of a real spherical-harmonic series in given directions.

    Parameters
    ----------
    coefficients : numpy.ndarray of complex, shape (degree + 1, degree + 1)
        a_nm in row n, column m, 0 <= m <= n [u]; those of m < 0 follow from a radius being real.
    directions : numpy.ndarray, shape (k, 3)
        Unit vectors.

    Returns
    -------
    numpy.ndarray, shape (k,), float64
        r [u], which may be negative where the series is.
    """
    load(_radius_kernel.module, "cpu")
    count = len(coefficients)
    pairs = np.ascontiguousarray(coefficients, np.complex128).view(np.float64).reshape(count, count, 2)
    radius = wp.empty(len(directions), dtype=wp.float64, device="cpu")
    raising, lowering, sectoral = _recurrence(count - 1)
    inputs = [
        shared_array(np.ascontiguousarray(directions, np.float64), wp.vec3d),
        shared_array(pairs, wp.vec2d),
        shared_array(raising, wp.float64),
        shared_array(lowering, wp.float64),
        shared_array(sectoral, wp.float64),
    ]
    wp.launch(_radius_kernel, dim=len(directions), inputs=inputs, outputs=[radius], device="cpu")
    return radius.numpy()


def is_coefficient_text(data: bytes) -> bool:
    """Whether a file's first line is one of coefficients: two whole numbers, two numbers."""
    words = data[:4096].lstrip().split(b"\n", 1)[0].split()
    try:
        n, m, _, _ = int(words[0]), int(words[1]), float(words[2]), float(words[3])
    except (IndexError, ValueError):
        return False
    return len(words) == 4 and abs(m) <= n


def is_geometry_table(data: bytes) -> bool:
    """Whether a file is NIST's table of sizes: its first line names the columns."""
    words = data[:4096].lstrip().split(b"\n", 1)[0].split()
    return len(words) > 8 and words[0].lower() == b"name" and b"Nnn" in words


def parse_coefficients(data: bytes) -> np.ndarray:
    """Coefficients in the bytes of a file of lines ``n m Re(a_nm) Im(a_nm)``.

    Parameters
    ----------
    data : bytes

    Returns
    -------
    numpy.ndarray of complex, shape (degree + 1, degree + 1)
        a_nm [mm] in row n, column m >= 0; zero above the diagonal.

    Raises
    ------
    FileFormatError
        If a line is not of that form, a coefficient is missing, given twice or not finite, those of m < 0 are
        given but do not mirror those of m > 0, or a_00 is not positive.
    """
    orders: list[tuple[int, int]] = []
    values: list[complex] = []
    for number, line in enumerate(data.decode("latin-1").splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        try:
            n, m, real, imaginary = words
            orders.append((int(n), int(m)))
            values.append(complex(float(real), float(imaginary)))
        except ValueError:
            raise FileFormatError(
                f"line {number}: expected n, m and the two parts of a coefficient, got {line.strip()[:60]!r}."
            ) from None
    given = dict(zip(orders, values, strict=True))
    _check_orders(orders, given)
    degree = max(n for n, _ in orders)
    table = np.zeros((degree + 1, degree + 1), np.complex128)
    for (n, m), value in given.items():
        if m >= 0:
            table[n, m] = value
    tolerance = _SYMMETRY_TOLERANCE * abs(table[0, 0])
    for (n, m), value in given.items():
        if m <= 0 and abs(value - (-1) ** m * table[n, -m].conjugate()) > tolerance:
            raise FileFormatError(
                f"the coefficients of degree {n} and orders {-m} and {m} give no real radius "
                "(expected a_n,-m = (-1)^m conj(a_nm)); check which convention the file follows."
            )
    if not table[0, 0].real > 0.0:
        raise FileFormatError(f"expected a positive coefficient of degree 0, got {table[0, 0].real:g}.")
    return table


def _check_orders(orders: list[tuple[int, int]], given: dict[tuple[int, int], complex]) -> None:
    """Refuse orders that do not exist, that come twice or are missing, and values that are not finite."""
    if not orders:
        raise FileFormatError("it holds no coefficients.")
    for (n, m), value in given.items():
        if abs(m) > n:
            raise FileFormatError(f"order {m} does not exist at degree {n}; check that it is an anm file.")
        if not (math.isfinite(value.real) and math.isfinite(value.imag)):
            raise FileFormatError(f"the coefficient of degree {n}, order {m} is not finite.")
    if len(given) != len(orders):
        raise FileFormatError(f"{len(orders) - len(given)} coefficients are given twice.")
    degree = max(n for n, _ in orders)
    lowest = -1 if any(m < 0 for _, m in orders) else 0
    # By count first, as a degree that is far too high would make the list of what is missing endless.
    expected = (degree + 1) ** 2 if lowest else (degree + 1) * (degree + 2) // 2
    if len(given) != expected:
        n, m = next((n, m) for n in range(degree + 1) for m in range(lowest * n, n + 1) if (n, m) not in given)
        raise FileFormatError(
            f"{expected - len(given)} coefficients up to degree {degree} are missing, the first of degree {n}, "
            f"order {m}; the file may be truncated."
        )


def read_coefficients(path: Path) -> np.ndarray:
    """Coefficients of a file; as `parse_coefficients`, with the file's name in each error."""
    try:
        return parse_coefficients(Path(path).read_bytes())
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from None
    except OSError as error:
        raise FileFormatError(f"{path}: it cannot be read ({error.strerror or error}); check its name.") from None


def read_geometry_table(path: Path) -> dict[str, dict[str, float]]:
    """NIST's table of sizes (``*-geom.dat``).

    Parameters
    ----------
    path : Path

    Returns
    -------
    dict of str to dict of str to float
        For each coefficient file's name the columns by their names, among them "volume" [mm^3], "surf_area"
        [mm^2], the extents "xlow" to "zhi" [mm], and "Nnn", the degree up to which the series is to be used.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is no such table, or a row has not as many numbers as there are columns.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise FileFormatError(f"{path}: it cannot be read ({error.strerror or error}); check its name.") from None
    if not is_geometry_table(data):
        raise FileFormatError(f"{path}: expected a first line of column names from Name on, with Nnn among them.")
    lines = [line.split() for line in data.decode("latin-1").splitlines() if line.strip()]
    columns, table = lines[0][1:], {}
    for words in lines[1:]:
        try:
            table[words[0]] = dict(zip(columns, map(float, words[1:]), strict=True))
        except ValueError:
            raise FileFormatError(f"{path}: the row of {words[0]} does not hold {len(columns)} numbers.") from None
    return table


@lru_cache(maxsize=64)
def _cached_table(path: Path, _changed: int) -> dict[str, dict[str, float]]:
    return read_geometry_table(path)


def usable_degree(path: Path) -> int | None:
    """Degree that the geometry table beside a coefficient file states for it (Nnn); None where there is none."""
    for table in sorted(Path(path).parent.glob("*-geom.dat")):
        row = _cached_table(table, table.stat().st_mtime_ns).get(Path(path).name)
        if row is not None:
            degree = row["Nnn"]
            if not (degree >= 0.0 and degree.is_integer()):
                raise FileFormatError(
                    f"{table}: expected a whole number Nnn from 0 for {Path(path).name}, got {degree:g}; correct it."
                )
            return int(degree)
    return None


def require_possible(triangles: int) -> None:
    """Raise a `MeshError` if a stone cannot be made of so many triangles (`TRIANGLES`)."""
    if not TRIANGLES[0] <= triangles <= TRIANGLES[1]:
        raise MeshError(f"expected {TRIANGLES[0]} to {TRIANGLES[1]} triangles, got {triangles}.")


def stone_of(coefficients: np.ndarray, *, degree: int | None = None, triangles: int = 20_000) -> Mesh:
    """Closed mesh of a spherical-harmonic stone.

    Every face spans a positive solid angle from the origin, whatever the radii, so that the mesh is star-shaped
    and sound if no radius is negative.

    Parameters
    ----------
    coefficients : numpy.ndarray of complex, shape (N + 1, N + 1)
        As `parse_coefficients` [u].
    degree : int, optional
        Highest degree used; all of them by default.
    triangles : int
        Asked number; the octahedral sphere of the nearest number 8 n^2 is used.

    Returns
    -------
    Mesh
        [u], about the origin of the series.

    Raises
    ------
    FileFormatError
        If the degree is not among those given, or the radius is not positive somewhere.
    MeshError
        If the number of triangles is out of its range.
    """
    require_possible(triangles)
    highest = len(coefficients) - 1
    used = highest if degree is None else int(degree)
    if not 0 <= used <= highest:
        raise FileFormatError(f"expected a degree from 0 to {highest}, the highest in the file, got {degree}.")
    ball = sphere("octahedral", max(1, round(math.sqrt(triangles / 8.0))))
    radius = evaluate_radius(coefficients[: used + 1, : used + 1], ball.vertices)
    lowest = int(radius.argmin())
    if not radius[lowest] > 0.0:
        x, y, z = ball.vertices[lowest]
        raise FileFormatError(
            f"the radius is {radius[lowest]:.4g} in the direction ({x:.3f}, {y:.3f}, {z:.3f}), where it should be "
            f"positive; use fewer than {used} degrees (max_degree)."
        )
    return ball.with_vertices(radius[:, None] * ball.vertices)
