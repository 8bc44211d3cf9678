"""GJK against an exact quadratic program and against certificates; benchmarks/verification.py runs 1e5 pairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import pytest
from dem_oracles import certified_distance, polytope_separation, weights_of
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from lithoform import Mesh, database_recipe, generate
from lithoform.dem import Core, Shape
from lithoform.dem.gjk import Hulls, Simplex, distance_pairs
from lithoform.presets import SHAPE_CLASSES
from lithoform.warp_runtime import load, wp

# Distances agree to this share of the size of the pair (spec: 1e-12); the larger of its bodies and its distance.
TOLERANCE = 1e-12


@dataclass
class Pairs:
    """Pairs of polyhedra: the two bodies of pair k are the blocks 2 k and 2 k + 1."""

    cores: list[Core]
    shape: np.ndarray
    scale: np.ndarray
    position: np.ndarray
    orientation: np.ndarray
    caches: np.ndarray = field(default=None)  # type: ignore[assignment]

    @property
    def count(self) -> int:
        return len(self.shape) // 2

    def vertices(self, block: int) -> np.ndarray:
        """In the world's frame."""
        turn = Rotation.from_quat(self.orientation[block]).as_matrix()
        return self.cores[self.shape[block]].vertices * self.scale[block] @ turn.T + self.position[block]

    def size(self, k: int) -> float:
        return max(float(np.ptp(self.vertices(2 * k + side), axis=0).max()) for side in (0, 1))


def hulls_of(cores: list[Core]) -> Hulls:
    def array(values, dtype):
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")

    starts, entries, total = [], [], 0
    for core in cores:
        begin, neighbours = core.adjacency
        starts.append(begin[:-1] + total)
        entries.append(neighbours)
        total += len(neighbours)
    hulls = Hulls()
    hulls.vertices = array(np.concatenate([core.vertices for core in cores]), wp.vec3d)
    hulls.first = array(np.cumsum([0, *(len(core.vertices) for core in cores)]).astype(np.int32), wp.int32)
    hulls.adjacency_first = array(np.concatenate([*starts, [total]]).astype(np.int32), wp.int32)
    hulls.adjacency = array(np.concatenate([*entries, [0]]).astype(np.int32), wp.int32)
    return hulls


def search(pairs: Pairs) -> dict[str, np.ndarray]:
    """What the kernel finds: separation, overlap, iterations, caches."""
    load(distance_pairs.module, "cpu")
    n = pairs.count

    def array(values, dtype):
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")

    caches = wp.zeros(n, dtype=Simplex, device="cpu") if pairs.caches is None else array(pairs.caches, Simplex)
    separation = wp.zeros(n, dtype=wp.vec3d, device="cpu")
    overlap, iterations = (wp.zeros(n, dtype=wp.int32, device="cpu") for _ in range(2))
    wp.launch(distance_pairs, n, [
        hulls_of(pairs.cores), array(pairs.shape.astype(np.int32), wp.int32), array(pairs.scale, wp.float64),
        array(pairs.position, wp.vec3d), array(pairs.orientation, wp.quatd),
        array(np.arange(2 * n, dtype=np.int32).reshape(-1, 2), wp.vec2i), caches, separation, overlap, iterations,
    ], device="cpu")  # fmt: skip
    return {"separation": separation.numpy(), "overlap": overlap.numpy(), "iterations": iterations.numpy(),
            "caches": caches.numpy()}  # fmt: skip


# ------------------------------------------------------------------------------------------ bodies


def hull_core(points: np.ndarray) -> Core:
    """Core of a convex hull, with all of Qhull's triangles."""
    hull = ConvexHull(points)
    used = np.unique(hull.simplices)
    order = np.full(len(points), -1)
    order[used] = np.arange(len(used))
    faces = hull.simplices.copy()
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return Core(points[used], order[faces], 0.05 * float(np.ptp(points, axis=0).min()))


def box_core(a: float, b: float, c: float, n: int = 1) -> Core:
    """A box whose faces are cut into n x n squares: many vertices in one plane, faces outward."""
    vertices: dict[tuple[int, int, int], int] = {}
    faces = []

    def vertex(p):
        return vertices.setdefault(tuple(int(x) for x in p), len(vertices))

    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, n):
            for i in range(n):
                for j in range(n):
                    corner = []
                    for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)):
                        p = np.zeros(3, int)
                        p[axis], p[u], p[v] = side, i + di, j + dj
                        corner.append(vertex(p))
                    w, x, y, z = corner if side == n else corner[::-1]
                    faces += [(w, x, y), (w, y, z)]
    points = (np.array(list(vertices)) / n - 0.5) * [a, b, c]
    return Core(points, np.array(faces), 0.05 * min(a, b, c))


def prism_core(sides: int, height: float, rings: int) -> Core:
    """A cylinder of many vertices, of which whole rings lie in one plane and whole columns on one line."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    levels = np.linspace(-0.5 * height, 0.5 * height, rings)
    points = np.array([(np.cos(t), np.sin(t), z) for z in levels for t in angle])
    faces = []
    for k in range(rings - 1):
        for i in range(sides):
            j = (i + 1) % sides
            p, q, r, s = k * sides + i, k * sides + j, (k + 1) * sides + j, (k + 1) * sides + i
            faces += [(p, q, r), (p, r, s)]
    top = (rings - 1) * sides
    for i in range(1, sides - 1):
        faces += [(0, i + 1, i), (top, top + i, top + i + 1)]
    return Core(points, np.array(faces), 0.05)


@lru_cache(maxsize=1)
def stones() -> list[Core]:
    """Eroded hulls of sixteen stones, of unit size."""
    cores = []
    for seed in range(4):
        for name in SHAPE_CLASSES:
            shape = Shape.from_mesh(generate(database_recipe(name, seed=seed).replace(triangles=2000)).mesh)
            cores.append(Core(shape.core.vertices / shape.radius, shape.core.faces, shape.core.margin / shape.radius))
    return cores


@lru_cache(maxsize=1)
def boxes() -> list[Core]:
    return [box_core(1, 1, 1), box_core(1, 2, 3), box_core(1, 1, 0.2), box_core(0.3, 0.3, 2)]


@lru_cache(maxsize=1)
def slivers() -> list[Core]:
    """Needles and plates of aspect 1:1000 and 1000:1000:1: boxes, double cones, lenses."""
    rng = np.random.default_rng(1)
    cloud = rng.normal(size=(60, 3))
    cloud /= np.linalg.norm(cloud, axis=1)[:, None]
    return [
        box_core(1e-3, 1e-3, 1), box_core(1, 1, 1e-3), hull_core(cloud * [0.5, 5e-4, 5e-4]),
        hull_core(cloud * [0.5, 0.5, 5e-4]), hull_core(np.array([[0, 0, 0.5], [0, 0, -0.5], [5e-4, 0, 0],
                                                                 [-3e-4, 4e-4, 0], [-3e-4, -4e-4, 0.1]])),
    ]  # fmt: skip


@lru_cache(maxsize=1)
def flats() -> list[Core]:
    """Bodies with many vertices in one plane or on one line."""
    ball = np.random.default_rng(2).normal(size=(300, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    cut = np.clip(ball, -0.7, 0.7)
    fine = box_core(1, 1, 1, 5)
    eroded = Shape.from_mesh(Mesh(fine.vertices, fine.faces)).core
    return [box_core(1, 1, 1, 6), box_core(1, 2, 0.3, 5), prism_core(24, 1.0, 6), prism_core(7, 0.05, 2),
            hull_core(cut), eroded]  # fmt: skip


# ------------------------------------------------------------------------------------------ families of pairs


def directions(rng: np.random.Generator, n: int) -> np.ndarray:
    d = rng.normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=1)[:, None]


def assembled(rng, cores, n, apart, *, orientation=None, shape=None, scale=None) -> Pairs:
    """n pairs, the second body of each `apart` from the first, both turned at random unless told."""
    shape = rng.integers(0, len(cores), 2 * n) if shape is None else shape
    position = rng.uniform(-1.0, 1.0, (2 * n, 3))
    position[1::2] = position[::2] + apart
    orientation = Rotation.random(2 * n, random_state=rng).as_quat() if orientation is None else orientation
    return Pairs(cores, shape, np.ones(2 * n) if scale is None else scale, position, orientation)


def random_stones(rng, n):
    return assembled(rng, stones(), n, directions(rng, n) * rng.uniform(0.5, 4.0, (n, 1)))


def parallel_boxes(rng, n):
    """Faces parallel, a common random turn; the projections of the faces may coincide exactly."""
    turn = np.repeat(Rotation.random(n, random_state=rng).as_quat(), 2, axis=0)
    turn[: n // 2 * 2] = [0, 0, 0, 1]
    shift = rng.integers(-2, 3, (n, 3)) * 0.5 + np.where(rng.random((n, 3)) < 0.3, rng.uniform(-1, 1, (n, 3)), 0.0)
    shift[np.arange(n), rng.integers(0, 3, n)] = rng.choice([-1, 1], n) * rng.uniform(0.5, 4, n)
    return assembled(rng, boxes(), n, Rotation.from_quat(turn[::2]).apply(shift), orientation=turn)


def needles_and_plates(rng, n):
    """Crossing, parallel, and nearly parallel ones."""
    turn = Rotation.random(n, random_state=rng)
    angle = rng.choice([0.0, 1e-9, 1e-6, 1e-3, 1.0], n)
    both = np.zeros((2 * n, 4))
    both[::2] = turn.as_quat()
    both[1::2] = (turn * Rotation.from_rotvec(directions(rng, n) * angle[:, None])).as_quat()
    apart = directions(rng, n) * 10.0 ** rng.uniform(-3.5, 0.5, (n, 1))
    return assembled(rng, slivers(), n, apart, orientation=both)


def coincident(rng, n):
    """The same body at the same place or next to it: they overlap."""
    cores = stones() + boxes() + flats()
    shape = np.repeat(rng.integers(0, len(cores), n), 2)
    turn = np.repeat(Rotation.random(n, random_state=rng).as_quat(), 2, axis=0)
    apart = directions(rng, n) * rng.choice([0.0, 1e-16, 1e-12, 1e-6, 1e-3], (n, 1))
    return assembled(rng, cores, n, apart, orientation=turn, shape=shape)


def far_apart(rng, n):
    return assembled(rng, stones() + boxes() + slivers(), n, directions(rng, n) * 10.0 ** rng.uniform(1, 3.3, (n, 1)))


def flat_bodies(rng, n):
    """Many vertices in one plane, faces parallel or nearly so in half of the pairs."""
    turn = Rotation.random(n, random_state=rng)
    both = np.zeros((2 * n, 4))
    both[::2] = turn.as_quat()
    tilt = directions(rng, n) * rng.choice([0.0, 1e-15, 1e-12, 1e-8, 1e-4, 1.0], (n, 1))
    quarter = Rotation.from_euler("xyz", rng.integers(0, 4, (n, 3)) * 90.0, degrees=True)
    both[1::2] = (turn * quarter * Rotation.from_rotvec(tilt)).as_quat()
    side = np.eye(3)[rng.integers(0, 3, n)] * rng.choice([-1, 1], (n, 1)) * rng.uniform(0.5, 3.0, (n, 1))
    side += rng.uniform(-0.3, 0.3, (n, 3)) * (rng.random((n, 1)) < 0.5)
    return assembled(rng, flats(), n, turn.apply(side), orientation=both)


def unequal_sizes(rng, n):
    """A body 100 to 10,000 times as large as the other, near its surface."""
    scale = np.ones(2 * n)
    scale[::2] = 10.0 ** rng.uniform(2, 4, n)
    pairs = assembled(rng, stones() + boxes() + flats(), n, np.zeros((n, 3)), scale=scale)
    for k in range(n):
        d = directions(rng, 1)[0]
        reach = (pairs.vertices(2 * k) - pairs.position[2 * k]) @ d
        top = pairs.vertices(2 * k)[int(reach.argmax())]
        pairs.position[2 * k + 1] = top + d * rng.uniform(0.0, 4.0)
    return pairs


def tiny_and_huge(rng, n):
    """Lengths of 1e-6 and 1e3: nothing may depend on the unit."""
    pairs = random_stones(rng, n)
    unit = np.repeat(rng.choice([1e-6, 1e3], n), 2)
    pairs.scale, pairs.position = pairs.scale * unit, pairs.position * unit[:, None]
    return pairs


def wrong_simplices(rng, n):
    """Caches of any vertices, the same one twice among them."""
    cores = stones() + boxes() + flats() + slivers()
    pairs = assembled(rng, cores, n, directions(rng, n) * rng.uniform(0.2, 4.0, (n, 1)))
    caches = np.zeros(n, dtype=Simplex.numpy_dtype())
    counts = np.array([len(core.vertices) for core in cores])
    caches["count"] = rng.integers(1, 4, n)
    for name, side in (("a0", 0), ("a1", 0), ("a2", 0), ("b0", 1), ("b1", 1), ("b2", 1)):
        caches[name] = (rng.random(n) * counts[pairs.shape[side::2]]).astype(np.int32)
    same = rng.random(n) < 0.2
    caches["a1"][same], caches["b1"][same] = caches["a0"][same], caches["b0"][same]
    pairs.caches = caches
    return pairs


def moved_to_gap(rng, n, gap) -> Pairs:
    """Bodies moved along their separation to a gap; the second half begins with the simplices of before."""
    pairs = assembled(rng, stones() + boxes() + flats(), n, directions(rng, n) * 6.0)
    found = search(pairs)
    length = np.linalg.norm(found["separation"], axis=1, keepdims=True)
    pairs.position[1::2] += found["separation"] / length * (length - gap)
    pairs.caches = found["caches"]
    pairs.caches["count"][: n // 2] = 0
    return pairs


def touching(rng, n):
    return moved_to_gap(rng, n, 10.0 ** rng.integers(-15, -2, (n, 1)))


def slightly_in(rng, n):
    return moved_to_gap(rng, n, -(10.0 ** rng.integers(-9, -2, (n, 1))))


FAMILIES: dict[str, Callable[[np.random.Generator, int], Pairs]] = {
    "random stones": random_stones,
    "boxes, faces parallel": parallel_boxes,
    "needles and plates 1:1000": needles_and_plates,
    "coincident": coincident,
    "far, to 2,000 sizes": far_apart,
    "many vertices in a plane": flat_bodies,
    "one 100 to 10,000 times larger": unequal_sizes,
    "sizes of 1e-6 and 1e3": tiny_and_huge,
    "wrong warm starts": wrong_simplices,
    "touching, gap 1e-3 to 1e-15": touching,
    "overlap of 1e-3 to 1e-9": slightly_in,
}


@dataclass
class Report:
    """Errors as shares of the size of the pair: against the quadratic program, and the width of the certificate."""

    pairs: int
    error: float
    unproven: float
    false_overlaps: int
    missed_overlaps: int
    not_finite: int
    iterations: float
    overlaps: int


def unproven(a, b, separation, solution, cache) -> float:
    """By how much a distance might be wrong: above the least gap of parallel planes, or off the points of the bodies.

    Two planes between the bodies prove that no points are nearer, whoever proposed their normal; the vertices of the
    cached simplex show that the separation joins two points of the bodies.
    """
    distance = float(np.linalg.norm(separation))
    size = max(float(np.ptp(a, axis=0).max()), float(np.ptp(b, axis=0).max()))
    if distance <= TOLERANCE * size:
        return 0.0
    lower = max(certified_distance(a, b, separation), certified_distance(a, b, solution))
    points = np.array([a[cache[f"a{i}"]] - b[cache[f"b{i}"]] for i in range(cache["count"])])
    weights, off = weights_of(points, separation)
    # A normal is known to rounding over distance, a lever as long as the body; a weight to rounding over flatness.
    rounding = 16.0 * np.finfo(float).eps * size * size / distance
    return max(distance - lower - rounding, off, -float(weights.min()) * size - 1e-9 * size)


def judged(pairs: Pairs) -> Report:
    """Compare the kernel with the quadratic program, and prove each distance by its planes."""
    found = search(pairs)
    report = Report(pairs.count, 0.0, 0.0, 0, 0, 0, float(found["iterations"].mean()), 0)
    for k in range(pairs.count):
        a, b = pairs.vertices(2 * k), pairs.vertices(2 * k + 1)
        separation, overlap = found["separation"][k], bool(found["overlap"][k])
        if not np.isfinite(separation).all():
            report.not_finite += 1
            continue
        solution = polytope_separation(a, b)
        exact = float(np.linalg.norm(solution))
        size = max(float(np.ptp(a, axis=0).max()), float(np.ptp(b, axis=0).max()), exact)
        distance = float(np.linalg.norm(separation))
        report.overlaps += exact <= TOLERANCE * size
        # Within rounding of touching, either answer is right.
        report.false_overlaps += overlap and exact > TOLERANCE * size
        report.missed_overlaps += not overlap and exact == 0.0 and distance > TOLERANCE * size
        if not overlap:
            report.error = max(report.error, abs(distance - exact) / size)
            report.unproven = max(report.unproven, unproven(a, b, separation, solution, found["caches"][k]) / size)
    return report


@pytest.mark.parametrize("family", FAMILIES)
def test_distances_are_those_of_the_quadratic_program(family):
    report = judged(FAMILIES[family](np.random.default_rng(20), 40))
    assert report.false_overlaps == report.missed_overlaps == report.not_finite == 0
    assert report.error < TOLERANCE
    assert report.unproven < TOLERANCE


@pytest.mark.parametrize(
    ("family", "seed", "number"),
    [
        # Faces 1e-8 off parallel: the next vertex of the way leads nearer by less than rounding.
        ("many vertices in a plane", 20, 271),
        ("many vertices in a plane", 20, 679),
        # Needles that cross: triangles 1e-7 times as high as long, whose weights lose half of their digits.
        ("needles and plates 1:1000", [2, 1000], 715),
        ("needles and plates 1:1000", [2, 6000], 785),
    ],
)
def test_pairs_that_once_were_wrong(family, seed, number):
    among = FAMILIES[family](np.random.default_rng(seed), 2000 if seed == 20 else 1000)
    two = slice(2 * number, 2 * number + 2)
    pair = Pairs(among.cores, among.shape[two], among.scale[two], among.position[two], among.orientation[two])
    report = judged(pair)
    assert report.error < TOLERANCE
    assert report.unproven < TOLERANCE
