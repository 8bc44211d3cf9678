"""The explorer's Dash application."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from lithoform.descriptors.table import FOUR
from lithoform.errors import FileFormatError, LithoformError
from lithoform.explorer.api import Context, add_api
from lithoform.explorer.callbacks import connect
from lithoform.explorer.design import DesignSpace
from lithoform.explorer.guard import guard
from lithoform.explorer.layout import layout
from lithoform.explorer.populations import Percentiles, Shelf
from lithoform.explorer.turns import Turns

if TYPE_CHECKING:
    from dash import Dash

    from lithoform.inverse.library import DesignLibrary

__all__ = ["find_library", "make_app"]

_PAGE: Final = """<!DOCTYPE html>
<html lang="en">
<head>{%metas%}<title>{%title%}</title><link rel="icon" href="data:,">{%css%}</head>
<body>{%app_entry%}<footer>{%config%}{%scripts%}{%renderer%}</footer></body>
</html>"""


def find_library() -> DesignLibrary | None:
    """The library that comes with the package, where there is one."""
    from lithoform.inverse.library import shipped_library

    try:
        return shipped_library()
    except (FileFormatError, FileNotFoundError):
        return None


def make_app(
    folder: str | os.PathLike[str] | None = None, library: DesignLibrary | None = None, *, host: str = "127.0.0.1"
) -> Dash:
    """The application, which `lithoform.explorer.serving` serves.

    Parameters
    ----------
    folder : path-like, optional
        A database, or a folder of databases: what the tab Population shows and percentiles are of.  Nothing else is
        read.
    library : DesignLibrary, optional
        What the tab Design space shows.
    host : str
        That the server will listen at: requests under other names are refused.

    Returns
    -------
    dash.Dash
        Its attribute `context` is the `Context`.

    Raises
    ------
    LithoformError
        If Dash is not installed.
    FileFormatError
        If the folder holds no database.
    """
    try:
        import dash
    except ImportError:
        raise LithoformError("the explorer needs Dash and Plotly; install lithoform[explorer].") from None
    from lithoform.warp_runtime import default_threads

    space = None if library is None else DesignSpace(library)
    shelf = None if folder is None else Shelf(folder)
    percentiles = None if shelf is None else shelf.percentiles()
    if percentiles is None and library is not None:
        columns = {name: library.descriptors[:, i] for i, name in enumerate(FOUR)}
        percentiles = Percentiles.of("the design library", columns)
    context = Context(space, shelf, percentiles, Turns(default_threads()))
    options: dict[str, Any] = {"enable_mcp": False} if "enable_mcp" in dash.Dash.__init__.__code__.co_varnames else {}
    app = dash.Dash(
        "lithoform.explorer",
        assets_folder=str(Path(__file__).parent / "assets"),
        title="lithoform explorer",
        update_title="",
        serve_locally=True,
        index_string=_PAGE,
        add_log_handler=False,
        suppress_callback_exceptions=True,  # two tabs come when they are opened
        **options,
    )
    # It would ask the makers of Dash whether there is a newer one.
    app.enable_dev_tools(debug=False, dev_tools_disable_version_check=True)
    app.layout = layout(context)
    connect(app, context)
    add_api(app.server, context)
    hashes = " ".join(f"'{digest}'" if not digest.startswith("'") else digest for digest in app.csp_hashes())
    app.server.config["LITHOFORM_POLICY"] = (
        f"default-src 'self'; script-src 'self' {hashes}; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; object-src 'none'; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'none'"
    )
    guard(app.server, host=host)
    app.context = context  # type: ignore[attr-defined]
    return app
