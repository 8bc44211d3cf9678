"""What the paper prints of its two databases (section 5): Tables 3 to 5, and what its text says to Fig. 8 to 10."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["PUBLISHED_ANOVA", "PUBLISHED_INDICES", "PublishedAnova", "PublishedIndices"]


@dataclass(frozen=True)
class PublishedAnova:
    """An analysis of variance as printed, two groups of one size.

    Attributes
    ----------
    size : int
        Particles in each group.
    groups, error, total : tuple of float
        Sum of squares and mean square.
    f, p, eta_squared : float
    interval : tuple of float
        Of the difference of means, printed without its sign.
    """

    size: int
    groups: tuple[float, float]
    error: tuple[float, float]
    total: tuple[float, float]
    f: float
    p: float
    eta_squared: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class PublishedIndices:
    """Indices, means and standard deviations as printed, scans first; None where the text gives none."""

    bhattacharyya: float
    kullback_leibler: float | None = None
    jensen_shannon: float | None = None
    means: tuple[float, float] | None = None
    deviations: tuple[float, float] | None = None


_Anova = PublishedAnova

PUBLISHED_ANOVA: Final[dict[str, dict[str, PublishedAnova]]] = {
    "table3": {
        "roundness": _Anova(600, (0.002851, 0.002851), (0.6943, 0.0005796), (0.6972, 0.0005815),
                            4.92, 0.02673, 0.0041, (0.000356, 0.00581)),
        "boxiness": _Anova(600, (0.01114, 0.01114), (1.3898, 0.00116), (1.4009, 0.001168),
                           9.6037, 0.001987, 0.008, (0.002236, 0.009952)),
        "solidity": _Anova(600, (0.001725, 0.001725), (0.1157, 0.00009657), (0.1174, 0.00009793),
                           17.8645, 0.00002552, 0.015, (0.001285, 0.003511)),
        "true_sphericity": _Anova(600, (0.01239, 0.01239), (3.2258, 0.002693), (3.2381, 0.002701),
                                  4.6008, 0.03216, 0.0038, (0.0005492, 0.0123)),
    },
    "table4": {
        "cube": _Anova(150, (0.0007956, 0.0007956), (0.06043, 0.0002028), (0.06123, 0.0002048),
                       3.9231, 0.04855, 0.0013, (0.00002094, 0.006493)),
        "plate": _Anova(150, (0.000364, 0.000364), (0.02145, 0.00007199), (0.02182, 0.00007297),
                        5.056, 0.02527, 0.017, (0.0002749, 0.004131)),
        "column": _Anova(150, (0.0003892, 0.0003892), (0.02832, 0.00009504), (0.02871, 0.00009602),
                         4.0953, 0.04389, 0.0014, (0.00006273, 0.004493)),
        "blade": _Anova(150, (0.0009083, 0.0009083), (0.04736, 0.0001589), (0.04827, 0.0001614),
                        5.7151, 0.01744, 0.0174, (0.0006153, 0.006345)),
    },
    "table5": {
        "cube": _Anova(150, (0.002619, 0.002619), (0.154, 0.0005166), (0.1566, 0.0005237),
                       5.0687, 0.02509, 0.017, (0.0007439, 0.01107)),
        "plate": _Anova(150, (0.003034, 0.003034), (0.2245, 0.0007534), (0.2275, 0.000761),
                        4.0267, 0.04569, 0.013, (0.0001227, 0.0126)),
        "column": _Anova(150, (0.003591, 0.003591), (0.2664, 0.000894), (0.27, 0.000903),
                         4.0174, 0.04594, 0.013, (0.0001256, 0.01371)),
        "blade": _Anova(150, (0.003878, 0.003878), (0.2625, 0.0008808), (0.2663, 0.0008908),
                        4.4033, 0.03671, 0.015, (0.000447, 0.01393)),
    },
}  # fmt: skip
"""By table and row.  Three eta squared of Table 4 are slips: see `lithoform.reproduce.populations`."""

PUBLISHED_INDICES: Final[dict[str, dict[str, PublishedIndices]]] = {
    "fig8": {
        "roundness": PublishedIndices(0.9840, None, 0.0139, (0.6513, 0.6482), (0.0223, 0.0257)),
        "boxiness": PublishedIndices(0.9824, None, 0.0173, (0.4158, 0.4097), (0.0334, 0.0347)),
        "solidity": PublishedIndices(0.9822, 0.1682, 0.0167, (0.8924, 0.8948), (0.0097, 0.0101)),
        "true_sphericity": PublishedIndices(0.9895, None, 0.0099, (0.8017, 0.8081), (0.0518, 0.0520)),
    },
    "fig9": {
        "cube": PublishedIndices(0.9537),
        "plate": PublishedIndices(0.9867, 0.0529, 0.0132),
        "column": PublishedIndices(0.9652),
        "blade": PublishedIndices(0.9615),
    },
    "fig10": {
        "cube": PublishedIndices(0.9640, means=(0.8414, 0.8473)),
        "plate": PublishedIndices(0.9595, means=(0.7783, 0.7846)),
        "column": PublishedIndices(0.9846, 0.0610, means=(0.7573, 0.7642)),
        "blade": PublishedIndices(0.9462, means=(0.7307, 0.7379)),
    },
}
"""By figure and panel."""
