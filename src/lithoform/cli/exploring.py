"""`lithoform explore`."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from lithoform.cli.arguments import Flag, Whole
from lithoform.cli.output import say


def explore(
    folder: Path | None = None,
    /,
    *,
    port: Whole = 8050,
    host: str = "127.0.0.1",
    open_: Flag = False,
    library: Path | None = None,
    debug: Flag = False,
) -> int:
    """Open the explorer, a local web page: the design space, a studio for single stones, populations.

    Ctrl-C ends it. The page loads nothing from elsewhere, and nobody but this machine reaches it.

    **Example:** `lithoform explore stones --open`

    Parameters
    ----------
    folder
        A database, or a folder of databases, for the tab Population and for percentiles. Nothing else is read.
    port
        Of the page; 0 takes any that is free.
    host
        Name or address to listen at. Any other than the default lets other machines in.
    open_
        Open the page in the browser.
    library
        Design library of the tab Design space, such as lithoform design library build makes [default: the one that
        comes with the program].
    debug
        Show the traceback of an error.
    """
    from lithoform.explorer.app import find_library, make_app
    from lithoform.explorer.guard import is_loopback
    from lithoform.explorer.serving import bind, serve
    from lithoform.inverse.library import read_library

    # What cannot be had is refused before the work.
    listener = bind(host, port)
    try:
        shown = find_library() if library is None else read_library(library)
        app = make_app(folder, shown, host=host)
        shelf = app.context.shelf  # type: ignore[attr-defined]
        for name, why in shelf.left_out.items() if shelf else ():
            print(f"lithoform: warning: the database {name} is left out: {why}", file=sys.stderr)
        if not is_loopback(host):
            print(f"lithoform: warning: others who reach {host} can use this page and its databases; there is no "
                  "password.", file=sys.stderr)  # fmt: skip

        def ready(address: str) -> None:
            say(f"The explorer is at {address} (Ctrl-C ends it).")
            if open_:
                import webbrowser

                webbrowser.open(address)

        is_quiet = serve(app, listener, host, ready)
    finally:
        listener.close()
    if not is_quiet:
        say("The explorer has ended; some work was still going on.")
        # Threads are inside native code, which does not stand the interpreter's own end.
        sys.stdout.flush()
        os._exit(0)
    say("The explorer has ended.")
    return 0
