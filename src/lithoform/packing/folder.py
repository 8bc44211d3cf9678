"""The folder of a packing."""

from __future__ import annotations

from typing import Final

from lithoform.result_folder import ResultFolder

__all__ = [
    "BLOCKS_FILE", "CHECKPOINT_FILE", "FOLDER", "MESHES_FOLDER", "NUMBERS_FILE", "PICTURE_FILE", "PROGRESS_FILE",
    "TABLE_FILE", "VTK_FOLDER",
]  # fmt: skip

NUMBERS_FILE: Final = "packing.json"
BLOCKS_FILE: Final = "blocks.csv"
TABLE_FILE: Final = "table.parquet"
PICTURE_FILE: Final = "packing.png"
CHECKPOINT_FILE: Final = "packing.checkpoint"
PROGRESS_FILE: Final = "progress.json"
VTK_FOLDER: Final = "vtk"
MESHES_FOLDER: Final = "vtk_meshes"

FOLDER: Final = ResultFolder(
    what="packing",
    numbers=NUMBERS_FILE,
    files=frozenset({NUMBERS_FILE, BLOCKS_FILE, TABLE_FILE, PICTURE_FILE, CHECKPOINT_FILE, PROGRESS_FILE}),
    series=(VTK_FOLDER, MESHES_FOLDER),
)
