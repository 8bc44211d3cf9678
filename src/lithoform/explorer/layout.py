"""The page: three tabs, their controls, and places that the page's own scripts fill."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from lithoform.descriptors.table import DESCRIPTORS, FOUR
from lithoform.explorer.populations import PAGE
from lithoform.presets import SHAPE_CLASSES

if TYPE_CHECKING:
    from lithoform.explorer.api import Context
    from lithoform.explorer.design import DesignSpace
    from lithoform.explorer.populations import Shelf

__all__ = ["DEFAULT_TARGET", "RANGES", "TABS", "layout", "population_panel", "space_panel"]

TABS: Final = {"space": "Design space", "studio": "Studio", "population": "Population"}
RANGES: Final = 2
"""Quantities whose range can be limited at the same time."""

DEFAULT_TARGET: Final = (0.30, 0.42, 0.90, 0.80)
_TOLERANCE: Final = 0.02
_NO_LIBRARY: Final = (
    "There is no design library yet. Build one with lithoform design library build; the other tabs work without."
)
_NO_DATABASE: Final = (
    "No database was named. Start the explorer with one: lithoform explore DIR. lithoform database build DIR makes one."
)


def layout(context: Context) -> Any:
    """Dash components of the page."""
    from dash import dcc, html

    tabs = [
        html.Button(
            label, id=f"tab-{name}", role="tab", className="tab", type="button", **_aria(controls=f"panel-{name}")
        )
        for name, label in TABS.items()
    ]
    # What needs Plotly is brought when somebody looks: the studio opens without its megabytes.
    waiting = html.P("Loading …", className="empty")
    panels = {
        "space": waiting if context.space else html.P(_NO_LIBRARY, className="empty"),
        "studio": _studio(),
        "population": waiting if context.shelf else html.P(_NO_DATABASE, className="empty"),
    }
    return html.Div(
        id="explorer",
        children=[
            dcc.Store(id="ready", data=1),
            dcc.Store(id="started"),
            dcc.Store(id="theme"),
            dcc.Store(id="opened-space"),
            dcc.Store(id="opened-population"),
            html.Header(
                [
                    html.H1("lithoform"),
                    html.Div(tabs, role="tablist", className="tabs", **_aria(label="Parts of the explorer")),
                    html.Div(id="status", role="status", **_aria(live="polite")),
                    html.Button("Dark", id="theme-button", type="button"),
                ]
            ),
            html.Div(id="notice", role="alert", hidden=True),
            html.Main(
                [
                    html.Section(
                        panels[name],
                        id=f"panel-{name}",
                        role="tabpanel",
                        className=f"panel panel-{name}",
                        **_aria(labelledby=f"tab-{name}"),
                    )
                    for name in TABS
                ]
            ),
        ],
    )


def _aria(**told: str) -> dict[str, Any]:
    """What screen readers are told of an element."""
    return {f"aria-{name}": text for name, text in told.items()}


def _labelled(text: str, control: Any, *, title: str = "") -> Any:
    from dash import html

    return html.Div([html.Label(text, htmlFor=control.id, title=title), control], className="field")


def _dropdown(identity: str, options: Any, value: Any, label: str, **more: Any) -> Any:
    from dash import dcc, html

    control = dcc.Dropdown(id=identity, options=options, value=value, clearable=False, searchable=False, **more)
    # The list is a button without a name of its own.
    return html.Div([html.Span(label, className="name"), control], className="field", role="group",
                    **_aria(label=label))  # fmt: skip


def _number(identity: str, value: Any, label: str, **more: Any) -> Any:
    from dash import dcc, html

    control = dcc.Input(id=identity, type="number", value=value, debounce=0.4, step="any", **more)
    return html.Label([html.Span(label, className="unseen"), control])


def space_panel(space: DesignSpace) -> list[Any]:
    """Dash components of the tab Design space."""
    from dash import dcc, html

    options = [{"label": space.label(name), "value": name, "title": space.meaning(name)} for name in space.quantities]
    axes = [_dropdown(f"axis-{letter}", options, name, f"{letter} axis") for letter, name in
            zip("xyz", ("roundness", "solidity", "true_sphericity"), strict=True)]  # fmt: skip
    rows = [html.Tr([html.Th(h, scope="col") for h in ("", "target", "tolerance", "weight")])]
    for name, value in zip(FOUR, DEFAULT_TARGET, strict=True):
        symbol = DESCRIPTORS[name].symbol.replace("_", "")
        fields = [
            html.Td(_number(f"{what}-{name}", start, f"{what} of {name}"))
            for what, start in (("target", value), ("tolerance", _TOLERANCE), ("weight", 1))
        ]
        rows.append(html.Tr([html.Th(symbol, scope="row", title=name.replace("_", " ")), *fields]))
    limits = [
        html.Div(
            [
                _dropdown(f"limit-{i}", options, FOUR[i], f"limit {i + 1}"),
                _number(f"least-{i}", None, f"least value of limit {i + 1}", placeholder="from"),
                _number(f"most-{i}", None, f"greatest value of limit {i + 1}", placeholder="to"),
            ],
            className="limit",
        )
        for i in range(RANGES)
    ]
    classes = dcc.Checklist(list(SHAPE_CLASSES), list(SHAPE_CLASSES), id="classes", inline=True)
    aside = [
        html.Fieldset([html.Legend("Axes"), *axes]),
        html.Fieldset([html.Legend("Target"), html.Table(rows, className="target")]),
        html.Fieldset(
            [
                html.Legend("Shown"),
                html.Div(classes, role="group", **_aria(label="Zingg classes")),
                dcc.Checklist([{"label": "within all tolerances", "value": "within"}], [], id="within"),
                *limits,
                _labelled("highlighted", dcc.Input(id="best", type="number", value=10)),
            ]
        ),
    ]
    # Placed by hand: the graph fills what is left of the window.
    graph = dcc.Graph(id="cloud", config={"displaylogo": False, "modeBarButtonsToRemove": ["toImage"]},
                      responsive=True, style={"height": "100%"})  # fmt: skip
    return [
        html.Aside(aside, className="controls"),
        html.Div(
            [dcc.Store(id="drawn"), html.Div(id="cloud-told", className="told"), html.Div(graph, className="graph")],
            className="middle",
        ),
        html.Aside(
            [
                html.Div(id="space-view", className="view"),
                html.Div(id="space-told", className="told"),
                html.Div(id="space-numbers"),
                html.H2("Best candidates"),
                html.Div(id="candidates"),
            ],
            className="beside",
        ),
    ]


def _studio() -> list[Any]:
    from dash import html

    return [
        html.Aside(
            [
                html.Div(id="studio-actions", role="toolbar", **_aria(label="Presets and history")),
                html.Form(id="studio-controls", className="controls-list"),
            ],
            className="controls",
        ),
        html.Div(
            [html.Div(id="studio-told", className="told"), html.Div(id="studio-view", className="view")],
            className="middle",
        ),
        html.Aside(
            [html.Div(id="studio-numbers"), html.Div(id="studio-files", role="toolbar", **_aria(label="Downloads"))],
            className="beside",
        ),
    ]


def population_panel(shelf: Shelf) -> list[Any]:
    """Dash components of the tab Population."""
    from dash import dcc, html

    sources = list(shelf.sources)
    names = shelf.measured(sources[:1])
    second = [{"label": "(none)", "value": ""}, *sources]
    shapes = [{"label": "all", "value": "all"}, *SHAPE_CLASSES]
    return [
        html.Aside(
            [
                html.Fieldset(
                    [
                        html.Legend("Sources"),
                        _dropdown("source-1", sources, sources[0], "first source"),
                        _dropdown("source-2", second, sources[1] if len(sources) > 1 else "", "second source"),
                        *(
                            html.P(f"{name} is left out: {why}", className="note refused")
                            for name, why in shelf.left_out.items()
                        ),
                    ]
                ),
                html.Fieldset(
                    [
                        html.Legend("Distribution"),
                        _dropdown("descriptor", names, names[0] if names else None, "descriptor"),
                        dcc.RadioItems(["histogram", "cumulative"], "histogram", id="kind", inline=True),
                        dcc.Checklist([{"label": "class by class", "value": "class"}], [], id="by-class"),
                    ]
                ),
                html.Fieldset(
                    [
                        html.Legend("Contact sheet"),
                        _dropdown("sheet-source", sources, sources[0], "stones of"),
                        _dropdown("sheet-class", shapes, "all", "class"),
                        html.Div(
                            [
                                html.Button(f"{PAGE} before", id="sheet-back", type="button"),
                                html.Button(f"Next {PAGE}", id="sheet-on", type="button"),
                                html.Button("Cancel", id="sheet-cancel", type="button"),
                            ],
                            className="row",
                        ),
                    ]
                ),
            ],
            className="controls",
        ),
        html.Div(
            [
                html.Div(id="distribution-told", className="told"),
                html.Div(
                    dcc.Graph(id="distribution", config={"displaylogo": False, "displayModeBar": False},
                              responsive=True, style={"height": "100%"}),
                    className="graph",
                ),
                html.Div(id="sheet-told", className="told"),
                html.Div(id="sheet", className="sheet"),
            ],
            className="middle",
        ),
        html.Aside(
            [
                html.Div(id="stone-view", className="view"),
                html.Div(id="stone-told", className="told"),
                html.Div(id="stone-numbers"),
            ],
            className="beside",
        ),
    ]  # fmt: skip
