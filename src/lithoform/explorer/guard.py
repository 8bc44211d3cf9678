"""Who may ask: requests must name this machine, and what starts work must come from this page."""

from __future__ import annotations

import ipaddress
import re
import socket
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from flask import Flask

__all__ = ["guard", "is_loopback", "refusal"]

_HOST: Final = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(?::[0-9]{1,5})?", re.ASCII)
_MAX_BODY: Final = 1 << 20  # [bytes]
_HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


def is_loopback(host: str) -> bool:
    """Whether a name or an address can be reached from this machine alone."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def refusal(
    method: str, headers: Any, *, host: str = "127.0.0.1", names: frozenset[str] = frozenset()
) -> str:  # fmt: skip
    """Why a request is refused, in one sentence; empty if it is not.

    Parameters
    ----------
    method : str
    headers : mapping of str to str
        Of the request.
    host : str
        That the server listens at.
    names : frozenset of str
        Further names of this machine.

    Notes
    -----
    A page of another origin can make a browser send requests here, and can make its own name mean this machine's
    address (DNS rebinding).  Against the first, what is not read only must have no foreign Origin and no other
    Sec-Fetch-Site than same-origin; against the second, the Host must be this machine's own: of a server that listens
    on the loopback alone a loopback name, of others an address or a name of the machine.
    """
    told = _HOST.fullmatch(headers.get("Host", "").lower())
    if told is None or not _is_own(told[1].strip("[]"), host.lower(), names):
        return "this server answers to its own name alone; open the address that it printed."
    if method in ("GET", "HEAD"):
        return ""
    origin, site = headers.get("Origin"), headers.get("Sec-Fetch-Site", "same-origin")
    if site not in ("same-origin", "none") or (origin is not None and origin.lower() != f"http://{told[0]}"):
        return "this request comes from another page; work in the page of the explorer itself."
    return ""


def _is_own(name: str, host: str, names: frozenset[str]) -> bool:
    if is_loopback(name) or name == host.strip("[]"):
        return True
    if is_loopback(host):
        return False
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name in names
    return True


def guard(server: Flask, *, host: str) -> None:
    """Refuse foreign requests of a Flask server with 403, and tell browsers what pages may load: this server alone."""
    from flask import Response, request
    from werkzeug.exceptions import HTTPException

    server.config["MAX_CONTENT_LENGTH"] = _MAX_BODY
    names = (
        frozenset({socket.gethostname().lower(), socket.getfqdn().lower()}) if not is_loopback(host) else frozenset()
    )

    @server.before_request
    def refuse() -> Response | None:
        told = refusal(request.method, request.headers, host=host, names=names)
        return Response(told, 403, mimetype="text/plain") if told else None

    @server.errorhandler(Exception)
    def tell(fault: Exception) -> Any:
        if isinstance(fault, HTTPException):
            return fault
        # What Dash raises for a path or a callback that is not its own; nobody reads a traceback here.
        return Response(f"the request cannot be answered ({type(fault).__name__}); reload the page.", 400,
                        mimetype="text/plain")  # fmt: skip

    @server.after_request
    def harden(response: Response) -> Response:
        response.headers.update(_HEADERS)
        response.headers.setdefault(
            "Content-Security-Policy", server.config.get("LITHOFORM_POLICY", "default-src 'self'")
        )
        return response
