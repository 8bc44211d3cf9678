"""Surrogate of the generator: the mean of each descriptor over the seeds, how well it is known, and the scatter.

    y(x) = m(x) + s(x) e,      m(x) = sum_j w_j phi_j(x),      log s^2(x) = sum_k v_k psi_k(x)

m is a Gaussian process with a squared-exponential kernel, one length scale an axis and a linear trend, in the
projected form of Quinonero-Candela and Rasmussen (2005): phi spans the kernels at the first points of the library,
which fill the space as the whole does.  s is fitted to the squared residuals by Fisher scoring of a gamma model with a
log link, and weighs the stones in the second fit of m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from lithoform.descriptors.table import FOUR
from lithoform.errors import SampleError
from lithoform.inverse.kernels import Kernel, fit_kernel, one_blas_thread
from lithoform.inverse.library import DesignLibrary
from lithoform.lazy import cached_property

__all__ = ["Prediction", "Surrogate", "kernels_of"]

_CENTRES: Final = 500
_SCATTER_RIDGE: Final = 1e-2
_SCORING_STEPS: Final = 12
_MOST_WORKING: Final = 4.0
_LEAST_SCATTER: Final = 0.05
"""Of the scatter over the whole library: a stone of a plain ellipsoid has none, and would weigh without bound."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """What stones of some settings are expected to measure.

    Attributes
    ----------
    mean : numpy.ndarray, shape (m, 4)
        Over the seeds.
    error : numpy.ndarray, shape (m, 4)
        Standard error of that mean surface.
    scatter : numpy.ndarray, shape (m, 4)
        Standard deviation from seed to seed.
    """

    mean: np.ndarray
    error: np.ndarray
    scatter: np.ndarray


@dataclass(frozen=True, eq=False)
class _Surface:
    """Mean surface of one descriptor."""

    kernel: Kernel
    centres: np.ndarray
    whitening: np.ndarray  # inverse of the Cholesky factor of the kernel between centres
    weights: np.ndarray
    radial: np.ndarray  # the weights of the kernels themselves
    factor: np.ndarray  # inverse of the Cholesky factor of the weights' precision

    @cached_property
    def _scaled(self) -> tuple[np.ndarray, np.ndarray]:
        return self.kernel.scaled(self.centres)

    def features(self, x: np.ndarray) -> np.ndarray:
        own = self.kernel.to_scaled(x, *self._scaled) @ self.whitening.T
        return np.column_stack([np.ones(len(x)), x - 0.5, own])

    def error(self, features: np.ndarray) -> np.ndarray:
        known = ((features @ self.factor.T) ** 2).sum(axis=1)
        own = features[:, -len(self.centres) :]
        unseen = self.kernel.variance * np.maximum(1.0 - (own**2).sum(axis=1) / self.kernel.variance, 0.0)
        return np.sqrt(known + unseen)

    def mean(self, x: np.ndarray) -> np.ndarray:
        """Mean alone, shape (m,)."""
        trend = self.weights[0] + (x - 0.5) @ self.weights[1 : 1 + x.shape[1]]
        return trend + self.kernel.to_scaled(x, *self._scaled) @ self.radial

    def with_slopes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean, and its derivatives by the coordinates, shape (m, d)."""
        d = x.shape[1]
        weighted = self.kernel.to_scaled(x, *self._scaled) * self.radial
        own = weighted.sum(axis=1)
        moved = weighted @ self.centres - own[:, None] * x
        mean = self.weights[0] + (x - 0.5) @ self.weights[1 : 1 + d] + own
        return mean, self.weights[1 : 1 + d] + moved / self.kernel.scales**2


@dataclass(frozen=True, eq=False)
class Surrogate:
    """A library made continuous; see `Surrogate.fit`."""

    surfaces: tuple[_Surface, ...]
    scatter_weights: np.ndarray
    least_scatter: np.ndarray

    @classmethod
    def fit(cls, library: DesignLibrary) -> Surrogate:
        """Fit to a library.

        Parameters
        ----------
        library : DesignLibrary
            Its kernels are taken from ``library.about["kernels"]`` if they are there, which is faster.

        Returns
        -------
        Surrogate
            The same numbers whatever the threads.

        Raises
        ------
        SampleError
            If the library has too few stones.
        """
        n, d = library.coordinates.shape
        if n < 10 * d:
            raise SampleError(f"a library of {d} axes needs at least {10 * d} stones; got {n}: build a larger one.")
        with one_blas_thread():
            kernels = kernels_of(library)
            x, terms = library.coordinates, _quadratic(library.coordinates)
            surfaces, scatters, least = [], [], []
            for kernel, y in zip(kernels, library.descriptors.T, strict=True):
                floor = _LEAST_SCATTER * float(np.sqrt(kernel.noise))
                surface = _basis(kernel, x[:_CENTRES])
                features = surface.features(x)
                some = slice(0, max(n // 4, min(n, 2 * _CENTRES)))
                rough = _fitted(surface, features[some], y[some], np.full(n, kernel.noise)[some])
                squares = (y - features @ rough.weights) ** 2
                first = _gamma_fit(terms, np.maximum(squares, (1e-3 * floor) ** 2))
                variance = np.maximum(np.exp(terms @ first), floor**2)
                surface = _fitted(surface, features, y, variance)
                squares = _corrected_squares(surface, features, y, variance)
                scatters.append(_gamma_fit(terms, np.maximum(squares, (1e-3 * floor) ** 2)))
                surfaces.append(surface)
                least.append(floor)
        return cls(tuple(surfaces), np.stack(scatters, axis=1), np.array(least))

    def predict(self, coordinates: np.ndarray) -> Prediction:
        """Mean, its error and the scatter at coordinates, shape (m, d)."""
        x = np.clip(np.asarray(coordinates, dtype=np.float64), 0.0, 1.0)
        with one_blas_thread():
            mean = np.stack([surface.mean(x) for surface in self.surfaces], axis=1)
            error = np.stack([surface.error(surface.features(x)) for surface in self.surfaces], axis=1)
        return Prediction(mean, error, self._scatter(x))

    def mean(self, coordinates: np.ndarray) -> np.ndarray:
        """The mean alone, shape (m, 4), which takes less time."""
        x = np.clip(np.asarray(coordinates, dtype=np.float64), 0.0, 1.0)
        with one_blas_thread():
            return np.stack([surface.mean(x) for surface in self.surfaces], axis=1)

    def with_slopes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Mean and scatter at one place, and the derivatives of the mean and of the logarithm of the scatter.

        Parameters
        ----------
        x : numpy.ndarray, shape (d,)

        Returns
        -------
        mean, scatter : numpy.ndarray, shape (4,)
        slopes, log_slopes : numpy.ndarray, shape (4, d)
        """
        place = np.clip(np.asarray(x, dtype=np.float64), 0.0, 1.0)[None]
        with one_blas_thread():
            pairs = [surface.with_slopes(place) for surface in self.surfaces]
        scatter = self._scatter(place)[0]
        own = 0.5 * _quadratic_slopes(place, self.scatter_weights)[0]
        held = scatter > self.least_scatter
        mean, slopes = (np.concatenate(part) for part in zip(*pairs, strict=True))
        return mean, scatter, slopes, own * held[:, None]

    def scatter(self, coordinates: np.ndarray) -> np.ndarray:
        """The scatter alone, shape (m, 4)."""
        return self._scatter(np.clip(np.asarray(coordinates, dtype=np.float64), 0.0, 1.0))

    def _scatter(self, x: np.ndarray) -> np.ndarray:
        logs = np.einsum("nt,tp->np", _quadratic(x), self.scatter_weights)
        return np.maximum(np.exp(0.5 * np.clip(logs, -40.0, 10.0)), self.least_scatter)


def kernels_of(library: DesignLibrary) -> tuple[Kernel, ...]:
    """Kernel of each descriptor: those that the library tells, or the most likely ones."""
    told = library.about.get("kernels")
    if told is not None and len(told) == len(FOUR):
        return tuple(Kernel(np.array(row["scales"]), row["variance"], row["noise"]) for row in told)
    return tuple(fit_kernel(library.coordinates, column) for column in library.descriptors.T)


def _basis(kernel: Kernel, centres: np.ndarray) -> _Surface:
    """Features of unit prior variance, phi = L^-1 k(z, x) with K(z, z) = L L^T, and no weights yet."""
    from scipy.linalg import solve_triangular

    own = kernel.between(centres, centres)
    own[np.diag_indices_from(own)] += 1e-6 * kernel.variance
    whitening = solve_triangular(np.linalg.cholesky(own), np.eye(len(own)), lower=True)
    return _Surface(kernel, centres, whitening, np.zeros(0), np.zeros(0), np.zeros((0, 0)))


def _fitted(surface: _Surface, features: np.ndarray, y: np.ndarray, variance: np.ndarray) -> _Surface:
    """Posterior of the weights with a noise of given variance."""
    from scipy.linalg import cho_factor, cho_solve, solve_triangular

    scaled = features / np.sqrt(variance)[:, None]
    precision = scaled.T @ scaled
    trend = 1 + surface.centres.shape[1]
    prior = np.ones(len(precision))
    prior[:trend] = 1e-4  # a trend of any size
    precision[np.diag_indices_from(precision)] += prior
    factor = cho_factor(precision, lower=True)
    weights = cho_solve(factor, scaled.T @ (y / np.sqrt(variance)))
    inverse = solve_triangular(np.tril(factor[0]), np.eye(len(precision)), lower=True)
    return replace(surface, weights=weights, radial=surface.whitening.T @ weights[trend:], factor=inverse)


def _corrected_squares(surface: _Surface, features: np.ndarray, y: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Squared residuals, each enlarged by what the fit has drawn towards its own stone."""
    leverage = ((features @ surface.factor.T) ** 2).sum(axis=1) / variance
    return (y - features @ surface.weights) ** 2 / np.clip(1.0 - leverage, 0.1, 1.0)


def _gamma_fit(terms: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Coefficients of the logarithm of a variance, by Fisher scoring: a fit of log e^2 would lean on the smallest."""
    weights = np.zeros(terms.shape[1])
    weights[0] = np.log(squares.mean())
    precision = terms.T @ terms / len(terms)
    precision[np.diag_indices_from(precision)] += np.where(np.arange(len(precision)) == 0, 0.0, _SCATTER_RIDGE)
    for _ in range(_SCORING_STEPS):
        logs = terms @ weights
        working = logs + np.clip(squares * np.exp(-logs) - 1.0, -1.0, _MOST_WORKING)
        weights = np.linalg.solve(precision, terms.T @ working / len(terms))
    # The bound on single stones makes the fit a little low, which one factor puts right.
    weights[0] += np.log((squares * np.exp(-(terms @ weights))).mean())
    return weights


def _quadratic(x: np.ndarray) -> np.ndarray:
    """Monomials up to degree 2 of 2 x - 1, shape (n, terms)."""
    z = 2.0 * x - 1.0
    rows, columns = np.triu_indices(x.shape[1])
    return np.column_stack([np.ones(len(x)), z, z[:, rows] * z[:, columns]])


def _quadratic_slopes(x: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Derivatives of the quadratics by x, shape (n, polynomials, d)."""
    z, d = 2.0 * x - 1.0, x.shape[1]
    rows, columns = np.triu_indices(d)
    matrix = np.zeros((weights.shape[1], d, d))
    matrix[:, rows, columns] = weights[1 + d :].T
    matrix = matrix + matrix.transpose(0, 2, 1)
    return 2.0 * (weights[1 : 1 + d].T[None] + np.einsum("pij,nj->npi", matrix, z))
