"""What the page's controls do: clouds and distributions here, the rest in the page's own scripts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from lithoform.descriptors.table import FOUR
from lithoform.errors import LithoformError
from lithoform.explorer.api import sentence
from lithoform.explorer.design import DesignSpace, Filter, target_of
from lithoform.explorer.figures import Sample, cloud, distributions
from lithoform.explorer.layout import RANGES, population_panel, space_panel
from lithoform.explorer.populations import Shelf, unit_of

if TYPE_CHECKING:
    from dash import Dash

    from lithoform.explorer.api import Context

__all__ = ["connect"]

_MOST_BEST: Final = 100


def connect(app: Dash, context: Context) -> None:
    """Add the callbacks of what the context has."""
    from dash import ClientsideFunction, Input, Output

    app.clientside_callback(ClientsideFunction("explorer", "start"), Output("started", "data"), Input("ready", "data"))
    app.clientside_callback(
        ClientsideFunction("explorer", "theme"), Output("theme", "data"), Input("theme-button", "n_clicks")
    )
    if context.space is not None:
        _connect_space(app, context.space)
    if context.shelf is not None:
        _connect_population(app, context.shelf)


def _connect_space(app: Dash, space: DesignSpace) -> None:
    from dash import ClientsideFunction, Input, Output, State, no_update

    app.callback(Output("panel-space", "children"), Input("opened-space", "data"), prevent_initial_call=True)(
        lambda _: space_panel(space)
    )
    axes = [Input(f"axis-{letter}", "value") for letter in "xyz"]
    target = {what: [Input(f"{what}-{name}", "value") for name in FOUR] for what in ("target", "tolerance", "weight")}
    limits = [[Input(f"{what}-{i}", "value") for what in ("limit", "least", "most")] for i in range(RANGES)]
    named = {name: Input(name, key) for name, key in
             (("classes", "value"), ("within", "value"), ("best", "value"), ("theme", "data"))}  # fmt: skip

    @app.callback(
        [
            Output("cloud", "figure"),
            Output("cloud-told", "children"),
            Output("candidates", "children"),
            Output("drawn", "data"),
        ],
        {"axes": axes, "target": target, "limits": limits, **named},
    )
    def draw(axes: Any, target: Any, limits: Any, classes: Any, within: Any, best: Any, theme: Any) -> Any:
        try:
            asked = target_of(target["target"], target["tolerance"], target["weight"])
            ranges = tuple((name, _limit(least, -math.inf), _limit(most, math.inf)) for name, least, most in limits)
            chosen = Filter(tuple(classes or ()), ranges, bool(within))
            indices = space.shown(chosen, asked)
            ranked = space.best(indices, asked, min(max(int(best or 0), 0), _MOST_BEST))
            figure = cloud(space, axes, asked, indices, ranked, theme=_theme(theme))
        except LithoformError as error:
            return no_update, sentence(error), no_update, no_update
        told = f"{len(indices):,} of {len(space):,} designs"
        if len(figure["data"]) < 4:
            told += "; the target has no place on these axes"
        return figure, f"{told}.", _candidates(space, asked, ranked, len(indices)), [indices.tolist(), ranked.tolist()]

    app.clientside_callback(
        ClientsideFunction("explorer", "pick"), Output("space-told", "title"), Input("cloud", "clickData"),
        State("drawn", "data"), prevent_initial_call=True,
    )  # fmt: skip


def _candidates(space: DesignSpace, target: Any, ranked: Any, left: int) -> Any:
    """A table of the best, whose buttons show a stone: the way to a point by keyboard."""
    from dash import html

    mismatch = space.mismatch(target)
    head = html.Tr([html.Th(text, scope="col") for text in ("design", "E", "R", "B", "S3D", "TS")])
    rows = []
    for index in map(int, ranked):
        values = [f"{value:.3f}" for value in space.library.descriptors[index]]
        named: dict[str, Any] = {"data-point": str(index)}
        button = html.Button(f"{index}", type="button", title=f"show design {index}", **named)
        rows.append(html.Tr([html.Td(button), *(html.Td(text) for text in (f"{mismatch[index]:.2f}", *values))]))
    if not rows:
        return "None is highlighted." if left else "No design is left by the filters."
    return html.Table([head, *rows])


def _connect_population(app: Dash, shelf: Shelf) -> None:
    from dash import ClientsideFunction, Input, Output, State, no_update

    app.callback(Output("panel-population", "children"), Input("opened-population", "data"), prevent_initial_call=True)(
        lambda _: population_panel(shelf)
    )

    @app.callback(
        [Output("descriptor", "options"), Output("descriptor", "value")],
        [Input("source-1", "value"), Input("source-2", "value")],
        State("descriptor", "value"),
        prevent_initial_call=True,
    )
    def offer(first: Any, second: Any, chosen: Any) -> Any:
        try:
            names = shelf.measured([source for source in (first, second) if source])
        except LithoformError:
            return no_update, no_update
        return names, chosen if chosen in names else (names[0] if names else None)

    @app.callback(
        [Output("distribution", "figure"), Output("distribution-told", "children")],
        [Input("source-1", "value"), Input("source-2", "value"), Input("descriptor", "value"), Input("kind", "value"),
         Input("by-class", "value"), Input("theme", "data")],
    )  # fmt: skip
    def draw(first: Any, second: Any, name: Any, kind: Any, by_class: Any, theme: Any) -> Any:
        try:
            if not name:
                raise LithoformError("these sources have no descriptor in common; choose others.")
            chosen = dict.fromkeys(source for source in (first, second) if source)
            samples = [Sample(source, *shelf.column(source, name)) for source in chosen]
            figure = distributions(samples, name, kind=kind, by_class=bool(by_class), unit=unit_of(name),
                                   theme=_theme(theme))  # fmt: skip
        except LithoformError as error:
            return no_update, sentence(error)
        told = ", ".join(f"{s.label}: {len(s.values):,} particles" for s in samples)
        return figure, f"{told}."

    app.clientside_callback(
        ClientsideFunction("explorer", "sheet"),
        Output("sheet-told", "title"),
        [Input("sheet-source", "value"), Input("sheet-class", "value")],
    )


def _limit(value: Any, default: float) -> float:
    return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else default


def _theme(value: Any) -> str:
    return "dark" if value == "dark" else "light"
