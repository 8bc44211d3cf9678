"""The house rules that a machine can hold: who imports whom, how long a module is, what an import costs."""

from __future__ import annotations

import ast
import graphlib
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "lithoform"
MODULES = sorted(PACKAGE.rglob("*.py"))
MAX_LINES = 500
HEAVY = (
    "SALib cyclopts dash dask distributed duckdb fast_simplification matplotlib plotly pyarrow pyvista rich scipy "
    "shapely trimesh vtk vtkmodules warp"
).split()

# Who may import whom inside the package. A name is a module or a folder; within a folder all is allowed.
FOUNDATION = {"errors", "lazy", "parameters", "presets", "seeds"}
MEASURES = {"descriptors", "lab", "mesh_io", "sidecar"}
MAY_IMPORT: dict[str, set[str]] = {
    # foundation
    "errors": set(),
    "lazy": set(),
    "seeds": {"errors"},
    "parameters": {"errors", "seeds"},
    "presets": {"errors", "parameters", "seeds"},
    "recipe_io": FOUNDATION,
    "axes": {"errors", "parameters"},
    # shape: noise -> radius; mesh -> conditioning; all -> generate
    "warp_runtime": {"errors"},
    "noise": FOUNDATION | {"warp_runtime"},
    "radius": FOUNDATION | {"noise", "topology", "warp_runtime"},
    "face_integrals": {"warp_runtime"},
    "mesh": {"errors", "face_integrals", "lazy"},
    "topology": {"errors", "mesh"},
    "predicates": {"errors", "warp_runtime"},
    "intersections": {"errors", "predicates", "warp_runtime"},
    "soundness": {"errors", "intersections", "mesh", "warp_runtime"},
    "conditioning": {"errors", "face_integrals", "mesh"},
    "flattening": {"errors", "mesh"},
    "feasibility": FOUNDATION | {"conditioning", "intersections", "topology"},
    "particle": FOUNDATION | {"figures", "mesh", "mesh_io", "rendering", "sidecar", "soundness"},
    "generation": FOUNDATION
    | {
        "conditioning",
        "feasibility",
        "flattening",
        "mesh",
        "noise",
        "parallel",
        "particle",
        "progress",
        "radius",
        "soundness",
        "topology",
        "warp_runtime",
    },
    # measure
    "parallel": {"warp_runtime"},
    "descriptors": FOUNDATION
    | {"conditioning", "face_integrals", "mesh", "parallel", "progress", "topology", "warp_runtime"},
    "lab": {"descriptors", "errors", "mesh"},
    "scans": {"errors", "mesh", "mesh_io", "soundness", "topology", "warp_runtime"},
    "simplification": {"errors", "mesh", "soundness"},
    "atomic": {"errors"},
    "mesh_io": {"atomic", "errors", "mesh", "parameters"},
    "sidecar": {"atomic", "errors", "mesh", "mesh_io"},
    "progress": set(),
    "locking": {"errors"},
    "result_folder": {"atomic", "errors", "locking"},
    "planning": FOUNDATION | {"feasibility", "mesh_io", "population_recipe", "recipe_io", "sidecar"},
    "production": FOUNDATION
    | {"atomic", "generation", "locking", "mesh_io", "particle", "planning", "progress", "sidecar"},
    # populations
    "population_recipe": FOUNDATION | {"axes", "recipe_io"},
    "database": FOUNDATION
    | MEASURES
    | {
        "atomic",
        "figures",
        "generation",
        "gradation",
        "locking",
        "mesh",
        "parallel",
        "particle",
        "planning",
        "progress",
        "recipe_io",
        "scans",
        "soundness",
        "topology",
        "warp_runtime",
    },
    "gradation": {"errors", "parameters", "seeds"},
    "statistics": {"errors"},
    "sensitivity": FOUNDATION | {"axes", "database", "descriptors", "generation", "parallel", "progress", "statistics"},
    "inverse": FOUNDATION
    | {
        "atomic",
        "axes",
        "database",
        "descriptors",
        "feasibility",
        "generation",
        "locking",
        "mesh",
        "parallel",
        "particle",
        "progress",
        "recipe_io",
        "sensitivity",
        "sidecar",
        "statistics",
    },
    # specimens: never the database
    "dem": {"atomic", "errors", "lazy", "mesh", "progress", "topology", "warp_runtime"},
    "packing": {
        "atomic",
        "database",
        "dem",
        "errors",
        "gradation",
        "locking",
        "mesh",
        "mesh_io",
        "parallel",
        "progress",
        "result_folder",
        "scans",
        "seeds",
        "sidecar",
    },
    "compaction": {
        "atomic",
        "database",
        "dem",
        "errors",
        "gradation",
        "locking",
        "packing",
        "parallel",
        "progress",
        "result_folder",
        "seeds",
        "sidecar",
        "statistics",
        "warp_runtime",
    },
    "export": {
        "atomic",
        "compaction",
        "database",
        "dem",
        "errors",
        "gradation",
        "lazy",
        "locking",
        "mesh",
        "packing",
        "parallel",
        "progress",
        "result_folder",
        "sidecar",
        "topology",
    },
    # results in, pictures and pages out; nothing is computed anew
    "rendering": {"errors", "mesh"},
    "figures": FOUNDATION | {"atomic", "descriptors", "mesh", "rendering", "statistics", "topology"},
    "survey": {"descriptors", "errors", "mesh_io", "parallel", "scans", "topology"},
    "portrait": {"descriptors", "errors", "figures", "parameters"},
    "run_report": {"figures", "mesh_io", "planning", "production", "sidecar"},
    "reproduce": FOUNDATION
    | {
        "atomic",
        "axes",
        "compaction",
        "compaction_report",
        "conditioning",
        "database",
        "descriptors",
        "experiment_report",
        "feasibility",
        "figures",
        "flattening",
        "generation",
        "gradation",
        "inverse",
        "locking",
        "mesh",
        "parallel",
        "particle",
        "planning",
        "portrait",
        "progress",
        "radius",
        "rendering",
        "report",
        "scans",
        "sensitivity",
        "sidecar",
        "simplification",
        "statistics",
        "survey",
        "warp_runtime",
    },
    "matching": FOUNDATION
    | {
        "axes",
        "database",
        "descriptors",
        "feasibility",
        "generation",
        "mesh_io",
        "parallel",
        "population_recipe",
        "progress",
        "scans",
        "statistics",
        "survey",
        "warp_runtime",
    },
    "report": {"database", "errors", "statistics"},
    "experiment_report": {"compaction", "figures", "report"},
    "study_report": {"compaction", "figures", "report"},
    "compaction_report": {"compaction", "dem", "figures", "report"},
    "comparison_report": {"atomic", "descriptors", "errors", "figures", "report", "sidecar", "statistics"},
}
# On top: these may import everything below them, `__init__` so as to hand it on.
MAY_IMPORT["__init__"] = set(MAY_IMPORT)
MAY_IMPORT["explorer"] = set(MAY_IMPORT)
MAY_IMPORT["cli"] = set(MAY_IMPORT)
MAY_IMPORT["__main__"] = {"cli"}


def name_of(path: Path) -> str:
    """Return the name in the table: the module, or the folder directly under the package."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def owner_of(dotted: str) -> str:
    """Return the name in the table of `lithoform.a.b`; a plain attribute of the package is `__init__`."""
    name = dotted.partition(".")[2].partition(".")[0]
    is_ours = name in MAY_IMPORT or (PACKAGE / name / "__init__.py").exists() or (PACKAGE / f"{name}.py").exists()
    return name if name and is_ours else "__init__"


def imports_of(path: Path) -> Iterator[str]:
    """Yield every import of ours in a module as a dotted name, those inside functions too."""
    package = ("lithoform", *path.relative_to(PACKAGE).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            origin = ".".join([*above, *([node.module] if node.module else [])])
            names = [f"{origin}.{alias.name}" for alias in node.names]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] == "lithoform")


def repository_files() -> list[Path]:
    """Return the files under version control and the new ones that git does not ignore."""
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    command = [git, "-c", f"safe.directory={ROOT}", "ls-files", "-z", "-co", "--exclude-standard"]
    listing = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [ROOT / name for name in listing.split("\0") if name and (ROOT / name).is_file()]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_module_imports_only_what_the_table_allows(path: Path) -> None:
    name = name_of(path)
    assert name in MAY_IMPORT, f"{name} is not in the table MAY_IMPORT: give it a place in the house"
    forbidden = {dotted for dotted in imports_of(path) if owner_of(dotted) not in MAY_IMPORT[name] | {name}}
    assert not forbidden, f"{name} may import {sorted(MAY_IMPORT[name])} of ours, not {sorted(forbidden)}"


def test_the_table_has_no_circle_and_names_only_itself() -> None:
    graphlib.TopologicalSorter(MAY_IMPORT).prepare()
    assert set().union(*MAY_IMPORT.values()) <= set(MAY_IMPORT)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_module_is_short(path: Path) -> None:
    lines = len(path.read_text(encoding="utf-8").splitlines())
    assert lines <= MAX_LINES, f"{path.name} has {lines} lines; split it by capability"


def test_no_file_names_a_package_index_or_a_folder_of_one_machine() -> None:
    banned = re.compile(
        r"https?://[^\s/]*(?:pypi\.org|pythonhosted\.org|npmjs\.org|debian\.(?:org|net))"
        r"|https?://\S+/simple\b"
        r"|^--(?:extra-)?(?:index-url|find-links)"
        r"|(?<![\w./<-])/(?:work|root|farm)\b",
        re.MULTILINE,
    )
    found = []
    for path in repository_files():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        found += [f"{path.relative_to(ROOT)}: {match.group()}" for match in banned.finditer(text)]
    assert not found


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = f"import sys, lithoform; print(*sorted(set({HEAVY}) & set(sys.modules)))"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert loaded.split() == []


def test_the_documentation_has_no_gaps_left() -> None:
    pages = [*(ROOT / "docs").glob("*.md"), ROOT / "README.md", ROOT / "CHANGELOG.md"]
    # Written apart, so that this file has none of them.
    marks = re.compile("|".join(a + b for a, b in (("PLACE", "HOLDER"), ("TO", "DO"), ("FIX", "ME"))))
    assert not [page.name for page in pages if marks.search(page.read_text(encoding="utf-8"))]
