"""Independent truths for the tests: the noise field in plain NumPy, closed forms, and meshes with known faults.

Written from the specification, not from the package: the hash, the interpolation (by lerps, one channel at a
time), the cellular search (any neighbourhood, clamped or not) and the reference directions are stated again
here.  `radius` is also the vectorised NumPy field that benchmarks/generation.py measures the kernel against.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np

# --------------------------------------------------------------------------------------------- sub-seeds and hash

WARP, RELIEF, CHIPS = 1, 2, 3  # roles of sub-seeds
MASK = 2**64 - 1


def sub_seed(seed: int, *words: int) -> int:
    """SplitMix64: its output function is applied once to the seed and once after each absorbed word."""
    state = seed
    for word in (0, *words):
        state = ((state ^ word) + 0x9E3779B97F4A7C15) & MASK
        state = ((state ^ state >> 30) * 0xBF58476D1CE4E5B9) & MASK
        state = ((state ^ state >> 27) * 0x94D049BB133111EB) & MASK
        state ^= state >> 31
    return state


def mix(h: np.ndarray, key: int) -> np.ndarray:
    """Finaliser of a 32-bit hash (xor-shift 16, multiply and add the key, xor-shift 15, multiply, xor-shift 16)."""
    h = h ^ (h >> np.uint32(16))
    h = h * np.uint32(0x7FEB352D) + np.uint32(key)
    h = h ^ (h >> np.uint32(15))
    h = h * np.uint32(0x846CA68B)
    return h ^ (h >> np.uint32(16))


PRIMES = np.array([0x8DA6B343, 0xD8163841, 0xCB1AB31F], dtype=np.uint32)
START = np.array([0x243F6A88, 0x85A308D3, 0x13198A2E], dtype=np.uint32)


def combine(cells: np.ndarray) -> np.ndarray:
    """One 32-bit word of the three coordinates of each cell, before any key and mixing."""
    # Modulo 2^32: the low half of the two's complement of each coordinate.
    words = (np.asarray(cells, dtype=np.int64) & 0xFFFFFFFF).astype(np.uint32) * PRIMES + START
    return words[:, 0] ^ words[:, 1] ^ words[:, 2]


def hash_cells(cells: np.ndarray, key: int) -> np.ndarray:
    """32 bits of each lattice cell: cells of shape (n, 3), a 64-bit key."""
    return mix(combine(cells) ^ np.uint32(key & 0xFFFFFFFF), key >> 32)


# --------------------------------------------------------------------------------------------- noise primitives

# The twelve vectors to the edge midpoints of a cube, in Perlin's (2002) order, and a regular tetrahedron of them.
EDGES = [(x, y, 0) for y in (1, -1) for x in (1, -1)]
EDGES += [(x, 0, z) for z in (1, -1) for x in (1, -1)]
EDGES += [(0, y, z) for z in (1, -1) for y in (1, -1)]
# The largest value that noise of these vectors can take (test_noise finds it), by which they are divided.
EDGE_SUPREMUM = 1.036353811211803
GRADIENT_TABLE = np.array([*EDGES, (1, 1, 0), (0, -1, 1), (-1, 1, 0), (0, -1, -1)], dtype=np.float64) / EDGE_SUPREMUM


def quintic(t):
    return 6.0 * t**5 - 15.0 * t**4 + 10.0 * t**3


def gradient_index(cells: np.ndarray, key: int, channel: int) -> np.ndarray:
    """Which of the sixteen gradients a lattice point has in a channel: four bits at 0, 8 and 16."""
    return (hash_cells(cells, key) >> np.uint32(8 * channel)) & np.uint32(15)


def gradient_noise(points, key: int, channel: int = 0, fade=quintic) -> np.ndarray:
    """Improved Perlin noise, shape (n,); complex points are allowed, for derivatives by the complex step."""
    points = np.asarray(points)
    cell = np.floor(points.real)
    t = points - cell
    cell = cell.astype(np.int64)

    def share(*corner):
        g = GRADIENT_TABLE[gradient_index(cell + corner, key, channel)]
        d = t - corner
        return g[:, 0] * d[:, 0] + g[:, 1] * d[:, 1] + g[:, 2] * d[:, 2]

    def lerp(a, b, w):
        return a + w * (b - a)

    u, v, w = (fade(t[:, i]) for i in range(3))
    bottom = lerp(lerp(share(0, 0, 0), share(1, 0, 0), u), lerp(share(0, 1, 0), share(1, 1, 0), u), v)
    top = lerp(lerp(share(0, 0, 1), share(1, 0, 1), u), lerp(share(0, 1, 1), share(1, 1, 1), u), v)
    return lerp(bottom, top, w)


def gradient_of_noise(points: np.ndarray, key: int, channel: int = 0) -> np.ndarray:
    """Gradient of the noise by the complex step (exact to rounding), shape (n, 3)."""
    step = 1e-30
    columns = [gradient_noise(points + 1j * step * np.eye(3)[i], key, channel).imag / step for i in range(3)]
    return np.stack(columns, axis=1)


def feature_jitter(cells: np.ndarray, key: int) -> np.ndarray:
    """32-bit words of the three coordinates of each cell's feature point, shape (n, 3)."""
    x = hash_cells(cells, key)
    y = mix(x * np.uint32(0x9E3779B1), 0x85EBCA77)
    z = mix(y * np.uint32(0x9E3779B1), 0xC2B2AE3D)
    return np.stack([x, y, z], axis=1)


def cellular_noise(points: np.ndarray, key: int, *, reach: int = 1, clamp: bool = True) -> np.ndarray:
    """(F1, F2), shape (n, 2), by a search over (2 reach + 1)^3 cells."""
    cell = np.floor(points)
    t = points - cell
    cell = cell.astype(np.int64)
    nearest = np.full(len(points), np.inf)
    second = np.full(len(points), np.inf)
    for offset in product(range(-reach, reach + 1), repeat=3):
        d = (offset - t) + feature_jitter(cell + offset, key) * 2.0**-32
        square = d[:, 0] ** 2 + d[:, 1] ** 2 + d[:, 2] ** 2
        closer = square < nearest
        second = np.where(closer, nearest, np.where(square < second, square, second))
        nearest = np.where(closer, square, nearest)
    distances = np.sqrt(np.stack([nearest, second], axis=1))
    return np.minimum(distances, 1.0) if clamp else distances


# --------------------------------------------------------------------------------------------- the field, eq. 1-10


def octave_weights(recipe) -> np.ndarray:
    """g^o over the sum of g^o (eq. 5); 0^0 = 1."""
    weights = np.array([recipe.gain**o for o in range(recipe.octaves)])
    return weights / weights.sum() if len(weights) else weights


def octaves_of(recipe, points: np.ndarray, role: int, channel: int):
    """Weight and noise of every octave."""
    for o, weight in enumerate(octave_weights(recipe)):
        yield weight, gradient_noise(recipe.lacunarity**o * points, sub_seed(recipe.seed, role, o), channel)


def fbm(recipe, points: np.ndarray, role: int = RELIEF, channel: int = 0) -> np.ndarray:
    """Eq. 5."""
    return sum((weight * p for weight, p in octaves_of(recipe, points, role, channel)), np.zeros(len(points)))


def ridges(recipe, points: np.ndarray, *, recentred: bool = True) -> np.ndarray:
    """Eq. 7, re-centred to [-1, 1] octave by octave (the specification's decision), or as printed."""
    out = np.zeros(len(points))
    for weight, p in octaves_of(recipe, points, RELIEF, 1):
        crest = (1.0 - np.abs(p)) ** 2
        out += weight * (2.0 * crest - 1.0 if recentred else crest)
    return out


def warped(recipe, directions: np.ndarray) -> np.ndarray:
    """Eq. 2 and 3: x = s u + eta w(s_w u + delta)."""
    q = recipe.warp_scale * directions + np.array(recipe.phase_offset)
    warp = np.stack([fbm(recipe, q, WARP, channel) for channel in range(3)], axis=1)
    return recipe.main_scale * directions + recipe.warp_strength * warp


def chip_bracket(recipe, points: np.ndarray) -> np.ndarray:
    """Eq. 8 before the mean is taken off, the exponent on the whole bracket."""
    f = cellular_noise(points, sub_seed(recipe.seed, CHIPS))
    return np.maximum(0.0, 1.0 - (f[:, 1] - f[:, 0])) ** recipe.chip_sharpness


@lru_cache(maxsize=1)
def reference_directions() -> np.ndarray:
    """The 10,002 directions of the octahedral sphere of 20,000 triangles, in an order of their own."""
    n = 50
    grid = np.array([p for p in product(range(-n, n + 1), repeat=2) if abs(p[0]) + abs(p[1]) <= n])
    z = n - np.abs(grid).sum(axis=1)
    points = np.concatenate([np.column_stack([grid, z]), np.column_stack([grid, -z])[z > 0]])
    points = np.sin(0.5 * np.pi * points / n)
    return points / np.linalg.norm(points, axis=1)[:, None]


def noise(recipe, directions: np.ndarray, reference: np.ndarray | None = None, *, recentred: bool = True) -> np.ndarray:
    """N(u) of eq. 4, 8, 9 and 10, shape (n,)."""
    if reference is None:
        reference = reference_directions()
    sites = directions if reference is directions else np.concatenate([reference, directions])
    x = warped(recipe, sites)
    chips = chip_bracket(recipe, x)
    fixed = slice(0, len(reference))
    normal = np.array(recipe.layer_normal) / np.linalg.norm(recipe.layer_normal)
    n = recipe.fbm_weight * fbm(recipe, x) + recipe.ridge_weight * ridges(recipe, x, recentred=recentred)
    n += recipe.chip_weight * (chips - chips[fixed].mean())
    n *= 1.0 + recipe.layer_amplitude * np.sin(2.0 * np.pi * recipe.layer_frequency * (x @ normal))
    n /= np.abs(n[fixed]).max() + 1e-12
    return n if reference is directions else n[len(reference) :]


def radius(
    recipe, directions: np.ndarray, reference: np.ndarray | None = None, *, recentred: bool = True
) -> np.ndarray:
    """r (1 + k N) kept above 0 (eq. 1), shape (n,); give `reference = directions` to evaluate the set once."""
    factor = 1.0 + recipe.perturbation * noise(recipe, directions, reference, recentred=recentred)
    low = 0.01 + np.clip(factor, 0.0, None) ** 2 / 0.04
    return recipe.base_radius * np.where(factor < 0.02, low, factor)


# --------------------------------------------------------------------------------------------- closed forms, bodies


def rotation(seed: int) -> np.ndarray:
    """A proper rotation, from the QR factors of random normal numbers."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def box(size, subdivided: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and outward faces of a box about the origin, each side an n x n grid of two triangles."""
    n = subdivided
    index, vertices, faces = {}, [], []

    def vertex(p):
        if p not in index:
            index[p] = len(vertices)
            vertices.append(p)
        return index[p]

    for axis, side in product(range(3), (0, n)):
        for i, j in product(range(n), repeat=2):
            corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            # (axis, axis + 1, axis + 2) is right-handed, so that this order is outward on the high side.
            quad = []
            for p, q in corners if side else corners[::-1]:
                point = [0, 0, 0]
                point[axis], point[(axis + 1) % 3], point[(axis + 2) % 3] = side, p, q
                quad.append(vertex(tuple(point)))
            faces += [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]
    return (np.array(vertices) / n - 0.5) * np.asarray(size, dtype=np.float64), np.array(faces)


def box_inertia(size) -> np.ndarray:
    """Inertia tensor of a solid box at unit density about its centre."""
    a, b, c = size
    return a * b * c / 12.0 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])


def ellipsoid_inertia(semi_axes) -> np.ndarray:
    """Inertia tensor of a solid ellipsoid at unit density about its centre."""
    a, b, c = semi_axes
    return 4.0 * np.pi * a * b * c / 15.0 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])


TETRAHEDRON = (
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float),
    [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
)
"""The corner of the unit cube: volume 1/6, centroid (1, 1, 1) / 4."""


def tetrahedron_inertia() -> np.ndarray:
    """Of `TETRAHEDRON` about its centroid: int x^2 = 1/60 and int xy = 1/120 about the corner."""
    second = np.full((3, 3), 1.0 / 120.0) + np.eye(3) / 120.0 - np.full((3, 3), 1.0 / 6.0 / 16.0)
    return np.trace(second) * np.eye(3) - second


def monte_carlo_moments(inside, low, high, count: int, seed: int):
    """Volume, centroid and second moments about the origin of a body, and their standard errors."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    x = np.random.default_rng(seed).uniform(low, high, size=(count, 3))
    hit = inside(x).astype(float)
    whole = float(np.prod(high - low))
    values = np.concatenate([hit[:, None], hit[:, None] * x, hit[:, None] * x**2], axis=1)
    return whole * values.mean(axis=0), whole * values.std(axis=0) / np.sqrt(count)


def torus(major: float = 2.0, minor: float = 0.7, m: int = 24, n: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Closed surface of Euler characteristic 0."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
    u, v = 2 * np.pi * i / m, 2 * np.pi * j / n
    ring = major + minor * np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], axis=1)
    a, b = i * n + j, ((i + 1) % m) * n + j
    c, d = ((i + 1) % m) * n + (j + 1) % n, i * n + (j + 1) % n
    return vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def wrapped_sphere(turns: int, rings: int = 8, sectors: int = 12, wobble: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A sphere wrapped `turns` times around its axis: Euler characteristic 2, every face positive from the centre.

    The sheets share the two poles, which are branch points; `wobble` lets the radius depend on the sheet.
    """
    m = sectors * turns
    i, j = (a.ravel() for a in np.meshgrid(np.arange(1, rings), np.arange(m), indexing="ij"))
    polar, turn = np.pi * i / rings, 2 * np.pi * j / sectors
    r = 1.0 + wobble * np.cos(turn / turns) * np.sin(polar)
    around = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=1)
    vertices = np.concatenate([[[0, 0, 1.0]], r[:, None] * around, [[0, 0, -1.0]]])
    faces = []
    for j in range(m):
        k = (j + 1) % m
        faces.append([0, 1 + j, 1 + k])
        for i in range(rings - 2):
            a, b = 1 + i * m + j, 1 + i * m + k
            faces += [[a, a + m, b + m], [a, b + m, b]]
        last = 1 + (rings - 2) * m
        faces.append([len(vertices) - 1, last + k, last + j])
    return vertices, np.array(faces)


def joined(*bodies: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Several bodies as one list of vertices and faces."""
    offsets = np.cumsum([0, *(len(v) for v, _ in bodies)])
    return (
        np.concatenate([v for v, _ in bodies]),
        np.concatenate([np.asarray(f) + o for (_, f), o in zip(bodies, offsets[:-1], strict=True)]),
    )


def solidity(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume over that of the convex hull (scipy's)."""
    from scipy.spatial import ConvexHull

    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 / ConvexHull(vertices).volume)
