"""A viser server that only this machine can reach by default."""

from __future__ import annotations

import errno
import functools
import re
import socket
from typing import Any

from skin.errors import SkinError, shown

__all__ = ["address_of", "open_server"]

LOOPBACK = re.compile(r"https?://(localhost|127(\.\d+){3}|\[::1\])(:\d+)?")
"""Origins of pages that may talk to a view on loopback. Pages of other origins in a browser on this
machine could otherwise press its buttons."""


def open_server(host: str, port: int | None, label: str) -> Any:
    """A viser server; one on loopback refuses pages of other origins, as does any other server of
    this process from then on.

    Parameters
    ----------
    host : str
        Address or name of this machine.
    port : int, optional
        The first free one from 8080 on if not given; 0 for any.
    label : str
        Title of the panel.

    Raises
    ------
    SkinError
        The port is in use, or the host is not an address of this machine.
    """
    import viser
    import websockets.asyncio.server as sockets

    class Server(viser.ViserServer):
        """Never exposed beyond this machine: a page cannot request it either."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            """Never: it would expose the skin to everybody with the link."""
            return None

    check_free(host, port)
    if is_loopback(host):
        sockets.serve = functools.partial(sockets.serve, origins=[LOOPBACK, None])
    server = Server(host=host, port=8080 if port is None else port, label=label, verbose=False)
    if port and server.get_port() != port:  # taken in between
        server.stop()
        raise SkinError(f"view: port: must be free; got {port}, in use")
    server.gui.configure_theme(
        dark_mode=True, show_logo=False, show_share_button=False, control_width="large"
    )
    return server


def check_free(host: str, port: int | None) -> None:
    """Raise where nothing can listen: viser would try other ports for ever.

    Raises
    ------
    SkinError
        The port is in use, or the host is not an address of this machine.
    """
    try:
        family, *_, place = socket.getaddrinfo(
            host, port or 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        socket.create_server(place, family=family).close()
    except (OSError, UnicodeError) as error:
        number = getattr(error, "errno", None)
        if number == errno.EADDRINUSE:
            raise SkinError(f"view: port: must be free; got {port}, in use") from None
        if number == errno.EACCES:
            raise SkinError(f"view: port: must be open to this user; got {port}") from None
        why = getattr(error, "strerror", None) or "no name of a host"
        raise SkinError(
            f"view: host: must be an address of this machine; got {shown(host)} ({why})"
        ) from None


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach it.

    Examples
    --------
    >>> is_loopback("127.0.0.1"), is_loopback("localhost"), is_loopback("0.0.0.0")
    (True, True, False)
    """
    return LOOPBACK.fullmatch(f"http://{host}") is not None or host == "::1"


def address_of(host: str, port: int) -> str:
    """URL for a browser.

    Examples
    --------
    >>> address_of("0.0.0.0", 8080), address_of("::1", 80)
    ('http://localhost:8080', 'http://[::1]:80')
    """
    if host in ("0.0.0.0", "::", ""):
        host = "localhost"
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
