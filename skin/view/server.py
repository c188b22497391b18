"""A viser server that only this machine can reach by default."""

from __future__ import annotations

import errno
import functools
import re
import socket
import sys
from typing import Any

from skin.errors import LibraryError, SkinError, shown

__all__ = ["address_of", "check_installed", "free_port", "open_server"]

FIRST_PORT, PORTS = 8080, 100
"""Ports that are tried where none is given."""
LOOPBACK = re.compile(r"https?://(localhost|127(\.\d+){3}|\[::1\])(:\d+)?")
"""Origins of pages that may talk to a view on loopback. Pages of other origins in a browser on this
machine could otherwise press its buttons."""
MISSING = "view: must have viser; not installed: pip install 'f3t-skin[view]'"


def check_installed() -> None:
    """Raise if viser is missing.

    Raises
    ------
    LibraryError
        It is not installed.
    """
    from importlib.util import find_spec

    if "viser" in sys.modules:
        is_there = sys.modules["viser"] is not None
    else:
        is_there = find_spec("viser") is not None
    if not is_there:
        raise LibraryError(MISSING)


def open_server(host: str, port: int | None, label: str, *, checks_origin: bool = False) -> Any:
    """A viser server on a free port.

    Parameters
    ----------
    host : str
        Address or name of this machine.
    port : int, optional
        The first free one from 8080 on if not given; 0 for any.
    label : str
        Title of the panel.
    checks_origin : bool
        Refuse pages of other origins. Affects the whole process, from then on.

    Raises
    ------
    SkinError
        The port is in use, or the host is not an address of this machine.
    LibraryError
        viser is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise LibraryError(MISSING) from error

    class Server(viser.ViserServer):
        """Never exposed beyond this machine: a page cannot request it either."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            """Never: it would expose the skin to everybody with the link."""
            return None

    chosen = free_port(host, port)
    if checks_origin and is_loopback(host):
        import websockets.asyncio.server as sockets

        sockets.serve = functools.partial(sockets.serve, origins=[LOOPBACK, None])
    server = Server(host=host, port=chosen, label=label, verbose=False)
    if port and server.get_port() != port:  # taken in between
        server.stop()
        raise SkinError(f"view: port: must be free; got {port}, in use")
    server.gui.configure_theme(
        dark_mode=True, show_logo=False, show_share_button=False, control_width="large"
    )
    return server


def free_port(host: str, port: int | None) -> int:
    """A port to listen on.

    Raises
    ------
    SkinError
        The port is in use, or the host is not an address of this machine.
    """
    tried = range(FIRST_PORT, FIRST_PORT + PORTS) if port is None else (port,)
    for one in tried:
        try:
            family, kind, *_, place = socket.getaddrinfo(
                host, one, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
            )[0]
            with socket.socket(family, kind) as listener:
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                listener.bind(place)
                listener.listen()
                return listener.getsockname()[1]
        except (OSError, UnicodeError) as error:
            number = getattr(error, "errno", None)
            if number == errno.EADDRINUSE:
                continue
            if number == errno.EACCES:
                raise SkinError(f"view: port: must be open to this user; got {one}") from None
            why = getattr(error, "strerror", None) or "no name of a host"
            raise SkinError(
                f"view: host: must be an address of this machine; got {shown(host)} ({why})"
            ) from None
    if port is None:
        raise SkinError(
            f"view: port: must be free; got {tried[0]} to {tried[-1]}, all of them in use"
        )
    raise SkinError(f"view: port: must be free; got {port}, in use")


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
