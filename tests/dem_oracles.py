"""Independent truths for the tests of the discrete element engine.

Written from the literature, not from the package: a quadratic program for the distance of polyhedra, the JKR law in 50
decimal digits, impacts in closed form, the motion of a free rigid body in Jacobi's elliptic functions, and estimators
of the density of a packing of spheres.
"""

from __future__ import annotations

import math
from decimal import Decimal, localcontext

import numpy as np

# ------------------------------------------------------------------------------------------ distance of polyhedra


def polytope_separation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Point of conv(a) less point of conv(b) where they are nearest: minimise |x|^2 over conv{a_i - b_j}.

    The active set method of Wolfe (1976), Math. Program. 11:128: all vertices are looked at for the next constraint,
    and the affine hull of the active ones is solved by least squares.  Where two planes do not prove the result to
    1e-13 of the size (faces that are all but parallel), the method goes on in rational numbers, in which it is exact.
    """
    size = max(float(np.ptp(a, axis=0).max()), float(np.ptp(b, axis=0).max()), 1e-300)
    x, active = _wolfe(a, b, size)
    length = float(np.linalg.norm(x))
    if length <= 1e-13 * size:
        return x
    rounding = 16.0 * np.finfo(float).eps * size * size / length
    if length - certified_distance(a, b, x) <= 1e-13 * max(size, length) + rounding:
        return x
    return exact_separation(a, b, active)


def _wolfe(a: np.ndarray, b: np.ndarray, size: float) -> tuple[np.ndarray, list[tuple[int, int]]]:
    active = [(0, 0)]
    points = (a[0] - b[0])[None]
    weights = np.ones(1)
    x = points[0]
    best, stalls = (np.inf, x, list(active)), 0
    for _ in range(300):
        i, j = int((a @ x).argmin()), int((b @ x).argmax())
        new = a[i] - b[j]
        square = float(x @ x)
        if square <= (1e-15 * size) ** 2:
            return np.zeros(3), active
        if square < best[0]:
            best, stalls = (square, x, list(active)), 0
        else:
            stalls += 1
        if square - float(x @ new) <= 1e-15 * square or stalls > 20:
            break
        # Of bodies with parallel edges many pairs of vertices make the same point.
        if (points == new).all(axis=1).any():
            break
        active.append((i, j))
        points = np.vstack([points, new])
        weights = np.append(weights, 0.0)
        while len(active) > 1:
            edges = (points[1:] - points[0]).T
            # Columns of unit length: needles and plates have edges of very different lengths.
            length = np.linalg.norm(edges, axis=0)
            free = np.linalg.lstsq(edges / length, -points[0], rcond=1e-14)[0] / length
            wanted = np.concatenate([[1.0 - free.sum()], free])
            if (wanted > 0.0).all():
                weights = wanted
                break
            with np.errstate(divide="ignore", invalid="ignore"):
                share = np.where(wanted <= 0.0, weights / (weights - wanted), np.inf)
            # The one that stops the move goes, whatever rounding leaves of it.
            keep = np.ones(len(weights), dtype=bool)
            keep[int(np.nanargmin(share))] = False
            weights = np.maximum(weights + min(1.0, float(np.nanmin(share))) * (wanted - weights), 0.0)
            keep &= weights > 0.0
            if not keep.any():
                keep[int(weights.argmax())] = True
            points, weights = points[keep], weights[keep] / weights[keep].sum()
            active = [pair for pair, kept in zip(active, keep, strict=True) if kept]
        x = weights @ points
    return best[1], best[2]


def exact_separation(a: np.ndarray, b: np.ndarray, active: list[tuple[int, int]] | None = None) -> np.ndarray:
    """The same minimum by the same method in rational numbers: no rounding but that of the result.

    Parameters
    ----------
    active : list of (int, int), optional
        Of these pairs of vertices the first is the start.
    """
    import itertools
    from fractions import Fraction

    size = max(float(np.ptp(a, axis=0).max()), float(np.ptp(b, axis=0).max()))
    rational: dict[tuple[int, int], tuple[Fraction, ...]] = {}

    def point(pair):
        if pair not in rational:
            rational[pair] = tuple(Fraction(float(p)) - Fraction(float(q)) for p, q in zip(a[pair[0]], b[pair[1]],
                                                                                         strict=True))  # fmt: skip
        return rational[pair]

    def dot(u, v):
        return sum(p * q for p, q in zip(u, v, strict=True))

    def combined(weights, points):
        return tuple(sum(w * p[k] for w, p in zip(weights, points, strict=True)) for k in range(3))

    def affine(points):
        """Weights of the point of an affine hull that is nearest to the origin."""
        edges = [tuple(p - q for p, q in zip(point_, points[0], strict=True)) for point_ in points[1:]]
        n = len(edges)
        rows = [[dot(u, v) for v in edges] + [-dot(u, points[0])] for u in edges]
        for k in range(n):
            pivot = next(r for r in range(k, n) if rows[r][k] != 0)
            rows[k], rows[pivot] = rows[pivot], rows[k]
            rows[k] = [value / rows[k][k] for value in rows[k]]
            for r in range(n):
                if r != k and rows[r][k] != 0:
                    rows[r] = [u - rows[r][k] * v for u, v in zip(rows[r], rows[k], strict=True)]
        free = [row[n] for row in rows]
        return [1 - sum(free), *free]

    pairs = [active[0] if active else (0, 0)]
    weights = [Fraction(1)]
    x = point(pairs[0])
    while True:
        if not any(x):
            return np.zeros(3)
        direction = np.array([float(c) for c in x])
        direction /= np.linalg.norm(direction)
        high, low = a @ direction, b @ direction
        # Floats choose those that may be the extreme ones, rational numbers decide.
        above = np.flatnonzero(high <= high.min() + 1e-12 * size)
        below = np.flatnonzero(low >= low.max() - 1e-12 * size)
        first = min((dot(x, [Fraction(float(c)) for c in a[i]]), i) for i in above)
        last = max((dot(x, [Fraction(float(c)) for c in b[j]]), j) for j in below)
        if first[0] - last[0] >= dot(x, x):
            return np.array([float(c) for c in x])
        pairs.append((int(first[1]), int(last[1])))
        weights.append(Fraction(0))
        while True:
            points = [point(pair) for pair in pairs]
            wanted = affine(points)
            if all(w > 0 for w in wanted):
                weights = wanted
                break
            step = min(w / (w - v) for w, v in zip(weights, wanted, strict=True) if v <= 0)
            weights = [w + step * (v - w) for w, v in zip(weights, wanted, strict=True)]
            kept = [w > 0 for w in weights]
            pairs, weights = list(itertools.compress(pairs, kept)), list(itertools.compress(weights, kept))
        x = combined(weights, points)


def certified_distance(a: np.ndarray, b: np.ndarray, separation: np.ndarray) -> float:
    """A distance that conv(a) and conv(b) certainly have: the gap of two parallel planes normal to a separation.

    With a separation that joins two points of the bodies, its length is an upper bound; where both agree, both are the
    distance (duality of the quadratic program), and no search was trusted.
    """
    length = float(np.linalg.norm(separation))
    if length == 0.0:
        return 0.0
    normal = separation / length
    return float((a @ normal).min() - (b @ normal).max())


def weights_of(points: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, float]:
    """Weights (sum 1) with which at most three points make a target, and how far they are from it."""
    if len(points) == 1:
        return np.ones(1), float(np.linalg.norm(points[0] - target))
    edges = (points[1:] - points[0]).T
    length = np.linalg.norm(edges, axis=0)
    free = np.linalg.lstsq(edges / length, target - points[0], rcond=1e-15)[0] / length
    weights = np.concatenate([[1.0 - free.sum()], free])
    return weights, float(np.linalg.norm(weights @ points - target))


# ------------------------------------------------------------------------------------------ JKR in decimal numbers

PI = Decimal("3.14159265358979323846264338327950288419716939937510582097")


def _cube_root(x: Decimal) -> Decimal:
    return (x.ln() / 3).exp() if x > 0 else Decimal(0)


def jkr_force(overlap: float, modulus: float, radius: float, energy: float) -> float:
    """Force of eq. 31 at an overlap, on the stable branch, in 50 digits; nan beyond the tear-off.

    The contact radius is found by bisection between the tear-off, where d overlap / d a = 0, and a radius that is large
    enough.
    """
    with localcontext() as context:
        context.prec = 50
        d, e, r, g = (Decimal(x) for x in (overlap, modulus, radius, energy))
        least = _cube_root(PI * g * r * r / (4 * e))

        def of(a: Decimal) -> Decimal:
            return a * a / r - (4 * PI * g * a / e).sqrt()

        if d < of(least):
            return math.nan
        low, high = least, 10 * least + (r * abs(d)).sqrt() * 2 + r / 10**9
        while of(high) < d:
            high *= 2
        for _ in range(150):
            middle = (low + high) / 2
            if of(middle) < d:
                low = middle
            else:
                high = middle
        a = (low + high) / 2
        return float(4 * e * a**3 / (3 * r) - (16 * PI * g * e * a**3).sqrt())


def jkr_landmarks(modulus: float, radius: float, energy: float) -> dict[str, float]:
    """Pull-off force (tension), and overlap and tension where the surfaces part if their distance is controlled."""
    with localcontext() as context:
        context.prec = 50
        e, r, g = (Decimal(x) for x in (modulus, radius, energy))
        least = _cube_root(PI * g * r * r / (4 * e))
        tension = (16 * PI * g * e * least**3).sqrt() - 4 * e * least**3 / (3 * r)
        return {
            "pull_off": float(3 * PI * g * r),
            "tear_off_overlap": float(-3 * least * least / r),
            "tear_off_tension": float(tension),
        }


# ------------------------------------------------------------------------------------------ impacts


def hertz_contact_time(mass: float, radius: float, modulus: float, speed: float) -> float:
    """Duration of an elastic impact: Johnson (1985), Contact Mechanics, eq. 11.24, in effective quantities.

    2 (15/16)^(2/5) integral_0^1 dx / sqrt(1 - x^(5/2)) = 2.8683 of (m^2 / (r E*^2 v))^(1/5); speed is that of approach.
    """
    # The integral is (2/5) B(2/5, 1/2).
    beta = math.gamma(0.4) * math.gamma(0.5) / math.gamma(0.9)
    return 2.0 * (15.0 / 16.0) ** 0.4 * 0.4 * beta * (mass**2 / (radius * modulus**2 * speed)) ** 0.2


def hertz_overlap(force: float, radius: float, modulus: float) -> float:
    """Overlap at a force without adhesion: F = 4/3 E* sqrt(r) overlap^(3/2)."""
    return (3.0 * force / (4.0 * modulus * math.sqrt(radius))) ** (2.0 / 3.0)


def gross_sliding(
    speed: float, angle: float, restitution: float, friction: float, radius: float
) -> tuple[float, float]:
    """Tangential speed and spin of a sphere after an oblique impact on a wall in which it slides all the time.

    The tangential impulse is friction times the normal one, m (1 + e) v_n, and acts at the arm of the radius: Kharaz,
    Gorham and Salman (2001), Powder Technol. 120:281; test 5 of Chung and Ooi (2011), Granul. Matter 13:643.
    """
    normal, along = speed * math.cos(angle), speed * math.sin(angle)
    impulse = friction * (1.0 + restitution) * normal
    return along - impulse, 2.5 * impulse / radius


# ------------------------------------------------------------------------------------------ free rigid body


def free_rotor(inertia: np.ndarray, spin: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Angular velocity in the frame of the body of a free asymmetric rotor: Landau and Lifshitz, Mechanics, eq. 37.10.

    inertia : ascending principal moments; spin : at the start, with its second component 0 and the first and the third
    positive.
    """
    from scipy.special import ellipj

    i1, i2, i3 = (float(x) for x in inertia)
    twice = float((inertia * spin**2).sum())
    square = float((inertia**2 * spin**2).sum())
    assert spin[1] == 0.0
    assert spin[0] > 0.0
    assert spin[2] > 0.0
    if square > twice * i2:
        rate = math.sqrt((i3 - i2) * (square - twice * i1) / (i1 * i2 * i3))
        modulus = (i2 - i1) * (twice * i3 - square) / ((i3 - i2) * (square - twice * i1))
        one = math.sqrt((twice * i3 - square) / (i1 * (i3 - i1)))
        two = math.sqrt((twice * i3 - square) / (i2 * (i3 - i2)))
        three = math.sqrt((square - twice * i1) / (i3 * (i3 - i1)))
        sn, cn, dn, _ = ellipj(rate * times, modulus)
        return np.stack([one * cn, two * sn, three * dn], axis=1)
    rate = math.sqrt((i2 - i1) * (twice * i3 - square) / (i1 * i2 * i3))
    modulus = (i3 - i2) * (square - twice * i1) / ((i2 - i1) * (twice * i3 - square))
    one = math.sqrt((twice * i3 - square) / (i1 * (i3 - i1)))
    two = math.sqrt((square - twice * i1) / (i2 * (i2 - i1)))
    three = math.sqrt((square - twice * i1) / (i3 * (i3 - i1)))
    sn, cn, dn, _ = ellipj(rate * times, modulus)
    return np.stack([one * dn, two * sn, three * cn], axis=1)


# ------------------------------------------------------------------------------------------ packings of spheres


def bulk_density(centres: np.ndarray, radius: float, low: np.ndarray, high: np.ndarray, spacing: float) -> float:
    """Share of a box that equal spheres fill, counted at the points of a lattice."""
    from scipy.spatial import cKDTree

    axes = [np.arange(a + 0.5 * spacing, b, spacing) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return float((cKDTree(centres).query(points)[0] < radius).mean())


def mean_contacts(centres: np.ndarray, radius: float, inside: np.ndarray) -> float:
    """Mean number of overlapping neighbours of the spheres inside, of equal size."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(centres).query_pairs(2.0 * radius, output_type="ndarray")
    counts = np.bincount(pairs.ravel(), minlength=len(centres))
    return float(counts[inside].mean())
