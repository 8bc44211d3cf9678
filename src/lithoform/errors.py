"""The few named exceptions: every fault a caller can act on is one of these.

A message is one plain sentence (or two) that says what was expected, what came, and the way out.
"""

from __future__ import annotations

from typing import Any

__all__ = [
    "DeviceError",
    "FileFormatError",
    "LithoformError",
    "MeshError",
    "OutputError",
    "RecipeError",
    "SampleError",
    "SceneError",
    "SimulationError",
    "UnsoundMeshError",
]


class LithoformError(Exception):
    """Base of every error that lithoform raises on purpose."""


class RecipeError(LithoformError, ValueError):
    """A recipe, a parameter of it, or a recipe file is not valid."""


class MeshError(LithoformError, ValueError):
    """A mesh cannot be used for what was asked."""


class UnsoundMeshError(MeshError):
    """A generated mesh failed the soundness check.

    Attributes
    ----------
    report : lithoform.soundness.SoundnessReport
        What was found, with counts and places.
    recipe : lithoform.parameters.Recipe or None
        The recipe that made the mesh, so that the fault can be made again.
    """

    def __init__(self, message: str, report: Any = None, recipe: Any = None) -> None:
        super().__init__(message)
        self.report = report
        self.recipe = recipe


class FileFormatError(LithoformError, ValueError):
    """A file's format is unknown, or its content is not what the format promises."""


class SampleError(LithoformError, ValueError):
    """A sample, or an option of a statistic, cannot be used for what was asked."""


class OutputError(LithoformError, OSError):
    """Results cannot be written where they were asked for."""


class SceneError(LithoformError, ValueError):
    """A material, a wall, a block or a setting of a simulation is not valid."""


class SimulationError(LithoformError, RuntimeError):
    """A simulation cannot go on.

    Attributes
    ----------
    time : float
        When, in the time of the simulation [s].
    bodies : tuple of int
        The blocks concerned, as far as they are known.
    """

    def __init__(self, message: str, *, time: float = float("nan"), bodies: tuple[int, ...] = ()) -> None:
        super().__init__(message)
        self.time = time
        self.bodies = bodies


class DeviceError(LithoformError, RuntimeError):
    """The compute device that was asked for is not there."""
