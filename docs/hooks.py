"""Fill the references from the tables of the code: `lithoform.PARAMETERS` and `lithoform.DESCRIPTORS`.

A line `<!-- parameters -->` becomes the table of all parameters, `<!-- parameter: NAME -->` the facts of one, and
`<!-- standard descriptors -->` and `<!-- further descriptors -->` the tables of measures.
"""

import math
import re
from typing import Any

from lithoform import DESCRIPTORS, PARAMETERS, Recipe
from lithoform.descriptors.table import Descriptor
from lithoform.parameters import Parameter

_COLUMNS = ("Symbol", "Name", "Unit", "Range", "Benchmark", "Equation")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Called by MkDocs for every page, with its source."""
    table = [_row(_COLUMNS), _row(["---"] * len(_COLUMNS)), *(_row(_facts(p)) for p in PARAMETERS)]
    markdown = markdown.replace("<!-- parameters -->", "\n".join(table))
    markdown = markdown.replace("<!-- standard descriptors -->", _descriptors(standard=True))
    markdown = markdown.replace("<!-- further descriptors -->", _descriptors(standard=False))
    return re.sub(r"<!-- parameter: (\w+) -->", _one, markdown)


def _descriptors(*, standard: bool) -> str:
    columns = ("Name", "Definition", "Unit", "Range", "Source")
    out = [_row(columns), _row(["---"] * len(columns))]
    for d in DESCRIPTORS.values():
        if d.is_standard == standard:
            unit = {0: "", 1: "m", 2: "m²", 3: "m³", 5: "m⁵"}[d.power]
            definition = f"`{d.symbol}`: {d.definition}" if d.symbol else d.definition
            if d.conventions:
                definition += f" (by {', '.join(d.conventions)})"
            out.append(_row((f"`{d.name}`", definition, unit, _descriptor_range(d), d.citation)))
    return "\n".join(out)


def _descriptor_range(d: Descriptor) -> str:
    if d.name == "zingg_class":
        return ""
    if d.high == math.inf:
        return "" if d.low == -math.inf else f"above {d.low:g}"
    return f"{d.low:g} to {d.high:g}"


def _one(match: re.Match[str]) -> str:
    (parameter,) = (p for p in PARAMETERS if p.name == match[1])
    symbol, _, unit, limits, benchmark, equation = _facts(parameter)
    facts = [f"Symbol {symbol}", f"unit {unit}", f"range {limits}", f"benchmark {benchmark}"]
    if equation:
        facts.append(f"equation {equation}")
    return ", ".join(facts) + "."


def _facts(parameter: Parameter) -> tuple[str, ...]:
    equation = re.search(r"eq\. (\d+)", parameter.meaning)
    return (
        f"`{parameter.symbol}`",
        f"`{parameter.name}`",
        parameter.unit,
        _limits(parameter),
        _number(getattr(Recipe(), parameter.name)),
        equation[1] if equation else "",
    )


def _limits(parameter: Parameter) -> str:
    if parameter.name == "seed":
        return "0 to 2⁶⁴ − 1"
    if parameter.kind == "integer":
        return f"{parameter.low:,} to {parameter.high:,}"
    text = parameter.range_text()
    return f"each {text}" if parameter.kind == "vector" else text


def _number(value: Any) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(_number(v) for v in value)})"
    return f"{value:,}" if isinstance(value, int) else f"{value:g}"


def _row(cells: Any) -> str:
    return f"| {' | '.join(cells)} |"
