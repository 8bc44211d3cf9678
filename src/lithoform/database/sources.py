"""What a source of a database is: a build or an import, and what it was asked for."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Final

from lithoform.sidecar import program_version

__all__ = ["Source", "differing_settings", "new_source"]

_ABSENT: Final = object()
_DIGEST: Final = "_sha256"


@dataclass(frozen=True)
class Source:
    """A build or an import of a database.

    Attributes
    ----------
    name : str
    kind : {"generated", "scanned"}
    count : int
        Particles that it has when it is complete.
    batch : int
        Particles a batch.
    keeps_meshes : bool
    lithoform : str
        Version of the program that makes its rows; their bytes are promised for one version alone.
    plan : dict
        What was asked for, in plain values.
    """

    name: str
    kind: str
    count: int
    batch: int
    keeps_meshes: bool
    lithoform: str
    plan: dict[str, Any]

    @property
    def batches(self) -> int:
        """Number of batches when it is complete."""
        return -(-self.count // self.batch)

    def numbers(self, batch: int) -> range:
        """Numbers of the particles of a batch; batches count from 1, as particles do."""
        return range((batch - 1) * self.batch + 1, min(batch * self.batch, self.count) + 1)

    def as_dict(self) -> dict[str, Any]:
        """As the manifest holds it, without the name."""
        return {key: value for key, value in vars(self).items() if key != "name"}


def new_source(name: str, kind: str, count: int, *, batch: int, keeps_meshes: bool, plan: dict[str, Any]) -> Source:
    """A source made by this version of the program, its plan as it comes back from JSON."""
    return Source(name, kind, count, batch, keeps_meshes, program_version(), json.loads(json.dumps(plan)))


def differing_settings(former: Source, source: Source) -> list[str]:
    """Names of the settings in which two sources differ, sorted; those of a recipe in a plan by their own names.

    What only follows from other settings, such as the size of a batch or a checksum, is told where it differs alone.
    """
    ours, theirs = _settings(former), _settings(source)
    names = {name for name in {*ours, *theirs} if ours.get(name, _ABSENT) != theirs.get(name, _ABSENT)}
    asked = sorted(name for name in names if name != "batch" and not name.endswith(_DIGEST))
    return asked or sorted(name.removesuffix(_DIGEST) for name in names)


def _settings(source: Source) -> dict[str, Any]:
    told = {**source.as_dict(), **source.plan}
    del told["plan"]
    found: dict[str, Any] = {}
    for name, value in told.items():
        if isinstance(value, dict):
            found |= {inner if inner not in told else f"{name} {inner}": v for inner, v in value.items()}
        else:
            found[name] = value
    return found
