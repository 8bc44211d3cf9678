"""Fill the references from the tables of the code: `lithoform.PARAMETERS` and `lithoform.DESCRIPTORS`.

A line `<!-- parameters -->` becomes the table of all parameters, `<!-- parameter: NAME -->` the facts of one, and
`<!-- descriptors -->` the table of all measures.
"""

import math
import re
from typing import Any

from lithoform import DESCRIPTORS, PARAMETERS, Recipe
from lithoform.parameters import Parameter

_COLUMNS = ("Symbol", "Name", "Unit", "Range", "Benchmark", "Equation")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Called by MkDocs for every page, with its source."""
    table = [_row(_COLUMNS), _row(["---"] * len(_COLUMNS)), *(_row(_facts(p)) for p in PARAMETERS)]
    markdown = markdown.replace("<!-- parameters -->", "\n".join(table))
    markdown = markdown.replace("<!-- descriptors -->", "\n".join(_descriptors()))
    return re.sub(r"<!-- parameter: (\w+) -->", _one, markdown)


def _descriptors() -> list[str]:
    columns = ("Name", "Symbol", "Definition", "Unit", "Range", "Depends on", "Set", "Source")
    out = [_row(columns), _row(["---"] * len(columns))]
    for d in DESCRIPTORS.values():
        unit = {0: "", 1: "m"}.get(d.power, f"m^{d.power}^")
        limits = (
            "" if d.name == "zingg_class" else f"above {d.low:g}" if d.high == math.inf else f"{d.low:g} to {d.high:g}"
        )
        kind = "standard" if d.is_standard else "on request"
        symbol = f"`{d.symbol}`" if d.symbol else ""
        cells = (f"`{d.name}`", symbol, d.definition, unit, limits, ", ".join(d.conventions), kind, d.citation)
        out.append(_row(cells))
    return out


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
