"""What the paper's section 6 reports, to be laid beside our own."""

from __future__ import annotations

from typing import Final

__all__ = ["COMPACTED_DENSITY", "FITS", "LOOSE_DENSITY"]

LOOSE_DENSITY: Final = (0.523, 0.536)
"""Packing densities of the loose mixtures, from the least to the greatest (Fig. 12a)."""

COMPACTED_DENSITY: Final = (0.574, 0.585)
"""Packing densities after gyration (Fig. 12b)."""

FITS: Final[tuple[tuple[tuple[float, float, float], ...], ...]] = (
    ((70.2147, -0.0286, 0.9961), (70.2923, -0.0288, 0.9968), (70.3315, -0.0288, 0.9953), (70.2563, -0.0285, 0.9959)),
    ((70.3466, -0.0292, 0.9944), (70.2953, -0.0288, 0.9966), (70.2147, -0.0286, 0.9961), (70.2916, -0.0287, 0.9968)),
    ((70.4046, -0.0293, 0.9955), (70.2816, -0.0289, 0.9960), (70.2718, -0.0288, 0.9956), (70.2821, -0.0288, 0.9953)),
    ((70.2622, -0.0289, 0.9953), (70.2762, -0.0289, 0.9967), (70.2687, -0.0287, 0.9955), (70.3451, -0.0291, 0.9927)),
    ((70.3231, -0.0290, 0.9940), (70.2463, -0.0286, 0.9953), (70.2644, -0.0288, 0.9930), (70.3105, -0.0289, 0.9918)),
    ((70.3283, -0.0292, 0.9920), (70.4271, -0.0295, 0.9932), (70.3520, -0.0291, 0.9950), (70.4287, -0.0294, 0.9937)),
)
"""A [mm], B and R2 of H = A G^B (Table 6): a row a case, first the scanned stones, then three generated samples."""
