"""The explorer's server: on the loopback unless told otherwise, ended by Ctrl-C or SIGTERM without ado."""

from __future__ import annotations

import contextlib
import errno
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Final

from lithoform.errors import OutputError

if TYPE_CHECKING:
    from dash import Dash

__all__ = ["bind", "serve"]

_PATIENCE: Final = 10.0  # [s] for work in progress when the server stops
_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


def bind(host: str, port: int) -> socket.socket:
    """A listening socket.

    Raises
    ------
    OutputError
        If the port is in use or not allowed, or the host is not of this machine.
    """
    if not 0 <= port <= 65535:
        raise OutputError(f"expected a port from 0 (any that is free) to 65535; got {port}.")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError):
        raise OutputError(f"expected a name or an address of this machine as --host; got {host!r}.") from None
    listener = socket.socket(family, kind, protocol)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(128)
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise OutputError(f"port {port} of {host} is in use; give another one with --port, or 0 for any that is "
                              "free.") from None  # fmt: skip
        raise OutputError(f"cannot listen at port {port} of {host}: {error.strerror}; give another --port or --host.") \
            from None  # fmt: skip
    return listener


def serve(app: Dash, listener: socket.socket, host: str, ready: Callable[[str], Any]) -> bool:
    """Serve until SIGINT or SIGTERM; of the main thread only.

    Parameters
    ----------
    app : dash.Dash
        Of `make_app`.
    listener : socket.socket
        Of `bind`; closed at the end.
    host : str
        For the address.
    ready : callable
        Called with the address once the server answers.

    Returns
    -------
    bool
        Whether all work in progress ended in time.
    """
    from werkzeug.serving import WSGIRequestHandler, make_server

    class Quiet(WSGIRequestHandler):
        """Says nothing of requests."""

        def log(self, type: str, message: str, *args: Any) -> None:
            pass

    port = listener.getsockname()[1]
    with contextlib.closing(listener):
        server = make_server(host, port, app.server, threaded=True, request_handler=Quiet, fd=listener.fileno())
        stop = threading.Event()
        with _signalled(stop):
            thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
            thread.start()
            shown = f"[{host}]" if ":" in host else host
            ready(f"http://{shown}:{port}/")
            stop.wait()
            server.shutdown()
            thread.join()
        server.server_close()
    return app.context.turns.stop(_PATIENCE)  # type: ignore[attr-defined]


@contextlib.contextmanager
def _signalled(stop: threading.Event) -> Iterator[None]:
    former = {number: signal.signal(number, lambda *_: stop.set()) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
