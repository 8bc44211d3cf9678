"""What section 4 of the paper says of the 15 parameters, in our words: a table of claims to be tested."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from lithoform.descriptors.table import FOUR

__all__ = ["ALL", "CLAIMS", "LEADING", "Claim", "Kind", "Size"]

Kind = Literal["falls", "rises", "changes", "rebounds", "threshold", "strongest", "most", "least", "between", "leading"]
Size = Literal["any", "negligible", "slight", "strong"]

ALL: Final = "all"
"""In the place of a parameter or a descriptor: all of them together."""


@dataclass(frozen=True)
class Claim:
    """One statement on one descriptor.

    Attributes
    ----------
    parameter : str
        Name of an axis, or `ALL`.
    descriptor : str
        Of `FOUR`, or `ALL`.
    text : str
    kind : str
        falls, rises: with the parameter; changes: by no more than its size says, in whatever direction; rebounds: falls
        to a least value inside the range and rises after it; threshold: changes little before a value and falls after
        it; strongest: no other parameter changes the descriptor as much; most, least, between: how the descriptor
        ranks among the four; leading: the parameters of `LEADING` act most.
    size : {"any", "negligible", "slight", "strong"}
        How much it changes, by the shares that `lithoform.sensitivity.trends` states.
    low, high : float or None
        Values between which it is said to hold; None is an end of the axis.
    at : float or None
        Value of a threshold.
    """

    parameter: str
    descriptor: str
    text: str
    kind: Kind
    size: Size = "any"
    low: float | None = None
    high: float | None = None
    at: float | None = None


_R, _B, _S, _TS = FOUR

LEADING: Final = (
    "perturbation", "main_scale", "octaves", "lacunarity", "gain", "fbm_weight", "ridge_weight", "chip_weight",
)  # fmt: skip
"""The parameters that appendix A calls the main controls of the shape: k, s, O, lambda, g, alpha, beta and gamma."""


def _each(parameter: str, descriptors: tuple[str, ...], text: str, kind: Kind, size: Size = "any",
          low: float | None = None, high: float | None = None) -> tuple[Claim, ...]:  # fmt: skip
    return tuple(Claim(parameter, name, text, kind, size, low, high) for name in descriptors)


_HARDLY: Final = "hardly changes"

CLAIMS: Final[tuple[Claim, ...]] = (
    Claim(ALL, _R, "changes most of the four", "most"),
    Claim(ALL, _B, "changes least of the four under each parameter", "least"),
    Claim(ALL, _S, "changes less than R and more than B", "between"),
    Claim(ALL, _TS, "changes less than R and more than B", "between"),
    Claim(ALL, ALL, "k, s, O, lambda, g, alpha, beta and gamma act most", "leading"),
    Claim("base_radius", _R, "falls slightly", "falls", "slight"),
    *_each("base_radius", (_B, _S, _TS), _HARDLY, "changes", "negligible"),
    *_each("perturbation", (_R, _S, _TS), "changes more than under any other parameter", "strongest"),
    Claim("perturbation", _R, "falls fast at small k", "falls", "strong", 0.0, 0.3),
    Claim("perturbation", _R, "rises again at high k", "rebounds"),
    *_each("perturbation", (_S, _TS), "falls", "falls"),
    Claim("perturbation", _B, "changes little", "changes", "slight"),
    *_each("main_scale", (_R, _S, _TS), "falls", "falls"),
    Claim("main_scale", _B, "drifts a little", "changes", "slight"),
    *(claim for name in ("warp_scale", "warp_strength") for claim in (
        Claim(name, _R, "falls fast", "falls", "strong"),
        *_each(name, (_S, _TS), "falls slightly", "falls", "slight"),
        Claim(name, _B, _HARDLY, "changes", "negligible"),
    )),
    *_each("phase_offset", FOUR, "fluctuates a little", "changes", "slight"),
    *_each("octaves", FOUR, "falls below O = 5", "falls", "any", 0.0, 5.0),
    Claim("lacunarity", _R, "changes little up to about 1 and falls after it", "threshold", at=1.0),
    Claim("lacunarity", _R, "falls sharply above 1", "falls", "strong", 1.0),
    *_each("lacunarity", (_S, _TS), "falls above 1", "falls", "any", 1.0),
    *_each("gain", FOUR, "hardly changes below 0.4", "changes", "negligible", 0.0, 0.4),
    *_each("gain", (_R, _S, _TS), "falls above 0.4", "falls", "any", 0.4),
    *_each("fbm_weight", (_R, _S, _TS), "rises", "rises"),
    Claim("fbm_weight", _B, "rises slightly", "rises", "slight"),
    Claim("ridge_weight", _R, "falls", "falls"),
    *_each("ridge_weight", (_S, _TS), "falls slightly", "falls", "slight"),
    *_each("chip_weight", FOUR, "rises", "rises"),
    *_each("chip_sharpness", FOUR, "falls", "falls"),
    *_each("layer_amplitude", FOUR, "falls slightly", "falls", "slight"),
    Claim("layer_frequency", _R, "falls", "falls"),
    *_each("layer_frequency", (_B, _S, _TS), _HARDLY, "changes", "negligible"),
)  # fmt: skip
"""Section 4, sentence by sentence, and the choice of parameters in appendix A."""
