"""What a page asks for besides Dash's own: recipes of links, stones as bytes, sheets and files.

What a request gets wrong is told in a sentence, with status 200, so that it does not fill a browser's list of faults.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from lithoform.errors import LithoformError, RecipeError
from lithoform.explorer.controls import controls
from lithoform.explorer.state import from_page, link_of, preset_recipe, recipe_of_link, to_page
from lithoform.explorer.stones import Stone, file_of, make_stone, pack
from lithoform.explorer.turns import SupersededError, Turns
from lithoform.parameters import Recipe
from lithoform.seeds import MAX_SEED

if TYPE_CHECKING:
    from flask import Flask, Response

    from lithoform.explorer.design import DesignSpace
    from lithoform.explorer.populations import Percentiles, Shelf

__all__ = ["Context", "add_api"]


@dataclass(frozen=True, eq=False)
class Context:
    """What the explorer shows.

    Attributes
    ----------
    space : DesignSpace or None
    shelf : Shelf or None
    percentiles : Percentiles or None
        Of the shelf, or else of the library.
    turns : Turns
    """

    space: DesignSpace | None
    shelf: Shelf | None
    percentiles: Percentiles | None
    turns: Turns


_MOST_TOLD: Final = 300  # characters


def sentence(error: Exception) -> str:
    """The message of an error on one line, without the recipe that some end with, and no longer than a few lines."""
    told = " ".join(str(error).partition("  The recipe:")[0].split()) or type(error).__name__
    return told if len(told) <= _MOST_TOLD else f"{told[:_MOST_TOLD]} …"


def add_api(server: Flask, context: Context) -> None:
    """Add the routes /api/... to a Flask server."""
    from flask import Response, request
    from werkzeug.exceptions import HTTPException

    answers = {
        "start": _start, "recipe": _recipe, "stone": _stone, "point": _point, "sheet": _sheet, "particle": _particle,
        "predict": _predict, "file": _file, "cancel": _cancel, "close": _close,
    }  # fmt: skip

    def answer(work: Callable[[Context, dict[str, Any]], Any]) -> Response:
        asked = request.get_json()
        try:
            if not isinstance(asked, dict):
                raise LithoformError("expected a table of names and values; reload the page.")
            found = work(context, asked)
        except HTTPException:
            raise
        except SupersededError:
            found = {"superseded": True}
        except LithoformError as error:
            found = {"error": sentence(error)}
        except Exception as error:
            found = {"error": f"unexpected fault ({type(error).__name__}: {sentence(error)})."}
        if isinstance(found, bytes):
            return Response(found, mimetype="application/octet-stream", headers={"Cache-Control": "no-store"})
        if isinstance(found, Response):
            return found
        return Response(json.dumps(found, default=str), mimetype="application/json")

    def route(work: Callable[[Context, dict[str, Any]], Any]) -> Callable[[], Response]:
        return lambda: answer(work)

    for name, work in answers.items():
        server.add_url_rule(f"/api/{name}", f"api_{name}", route(work), methods=["POST"])


def _start(context: Context, asked: dict[str, Any]) -> dict[str, Any]:
    percentiles = context.percentiles
    return {**controls(), "benchmark": to_page(Recipe()), "population": percentiles.label if percentiles else None}


def _recipe(context: Context, asked: dict[str, Any]) -> dict[str, Any]:
    if "preset" in asked:
        former = from_page({name: asked[name] for name in ("seed", "triangles") if name in asked})
        recipe = preset_recipe(str(asked["preset"]), seed=former.seed, triangles=former.triangles)
    else:
        recipe = recipe_of_link(str(asked.get("link", "")))
    return {"recipe": to_page(recipe), "link": link_of(recipe)}


def _stone(context: Context, asked: dict[str, Any]) -> bytes:
    recipe = from_page(asked.get("recipe"))
    ticket = context.turns.enter(asked.get("page"), "studio", asked.get("turn"))
    with ticket.working():
        stone = make_stone(recipe, ticket)
    return pack(_placed(context, stone, {"link": link_of(recipe)}))


def _design(context: Context, index: Any) -> DesignSpace:
    if context.space is None:
        raise LithoformError("there is no design library; build one with lithoform design library build.")
    if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(context.space):
        raise LithoformError(f"expected a design from 0 to {len(context.space) - 1}; reload the page.")
    return context.space


def _predict(context: Context, asked: dict[str, Any]) -> dict[str, Any]:
    index: Any = asked.get("index")
    space = _design(context, index)
    ticket = context.turns.enter(asked.get("page"), "space", asked.get("turn"))
    return space.predicted(index, ticket)


def _point(context: Context, asked: dict[str, Any]) -> bytes:
    index: Any = asked.get("index")
    space = _design(context, index)
    seed = asked.get("seed", 0)
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed <= MAX_SEED:
        raise RecipeError("expected a seed from 0 to 2^64 - 1; reload the page.")
    ticket = context.turns.enter(asked.get("page"), "space", asked.get("turn"))
    recipe = space.library.recipe(index, seed)
    with ticket.working():
        stone = make_stone(recipe, ticket)
    told = {"index": index, "seed": str(seed), "recipe": to_page(recipe),
            "values": space.values_at(index), "link": link_of(recipe)}  # fmt: skip
    return pack(_placed(context, stone, told))


def _sheet(context: Context, asked: dict[str, Any]) -> dict[str, Any]:
    return _shelf(context).sheet(asked.get("source"), asked.get("class", "all"), asked.get("start", 0))


def _particle(context: Context, asked: dict[str, Any]) -> bytes:
    shelf = _shelf(context)
    channel = "sheet" if asked.get("small") else "stone"
    ticket = context.turns.enter(asked.get("page"), channel, asked.get("turn"))
    with ticket.working():
        return pack(shelf.stone(asked.get("source"), asked.get("number")))


def _file(context: Context, asked: dict[str, Any]) -> Response:
    from flask import Response

    recipe = from_page(asked.get("recipe"))
    ticket = context.turns.enter(asked.get("page"), "file", asked.get("turn"))
    with ticket.working():
        name, media, content = file_of(recipe, str(asked.get("kind")), ticket)
    return Response(content, headers={"Content-Type": media, "X-Filename": name, "Cache-Control": "no-store"})


def _cancel(context: Context, asked: dict[str, Any]) -> dict[str, Any]:
    context.turns.enter(asked.get("page"), asked.get("channel"), asked.get("turn"))
    return {}


def _close(context: Context, asked: dict[str, Any]) -> dict[str, Any]:
    context.turns.close(asked.get("page"))
    return {}


def _shelf(context: Context) -> Shelf:
    if context.shelf is None:
        raise LithoformError("there is no database; start the explorer with a folder: lithoform explore DIR.")
    return context.shelf


def _placed(context: Context, stone: Stone, told: dict[str, Any]) -> Stone:
    known, places = context.percentiles, {}
    if known is not None:
        values = stone.told["descriptors"]
        places = {name: known.place(name, values[name]) for name in known.columns if name in values}
    return Stone(stone.mesh, {**stone.told, **told, "percentiles": places})
