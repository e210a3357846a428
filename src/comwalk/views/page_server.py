"""The server of a page in the browser, and its errors."""

from __future__ import annotations

import socket
from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from ..errors import ViewError, checked_number

if TYPE_CHECKING:
    import viser


HOST, PORT = "127.0.0.1", 8080
"""Where pages are served unless told otherwise."""


class Address(NamedTuple):
    """The address of a page."""

    host: str = HOST
    """Address to listen at."""
    port: int = PORT
    """Port; 0 for any that is free."""
    open: bool = False
    """Whether to open this machine's browser."""


@contextmanager
def open_server(host: str = HOST, port: int = 0) -> Generator[viser.ViserServer]:
    """Open a page's server; close it without a word.

    Args:
        host: Address to listen at.
        port: Port; 0 for any that is free.

    Yields:
        The server.

    Raises:
        ViewError: If the port is in use, or the address is not this machine's.
    """
    import viser

    check_free(host, port)
    with _silent_rich():
        server = viser.ViserServer(host=host, port=port, label="comwalk", verbose=False)
    try:
        yield server
    finally:
        with _silent_rich():
            server.stop()


@contextmanager
def _silent_rich() -> Generator[None]:
    """Keep viser, which prints by rich, from greeting and from saying goodbye."""
    import rich

    console = rich.get_console()
    quiet, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = quiet


def check_free(host: str, port: int) -> None:
    """Refuse a port that a page cannot be served at.

    Args:
        host: Address to listen at.
        port: Port; 0 for any that is free.

    Raises:
        ParameterError: If the port is no port's number.
        ViewError: If it is in use, or the address is not this machine's.
    """
    checked_number("port", port, low=0, high=65535)
    try:
        kind = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(kind[0], kind[1]) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(kind[4])
    except OSError as error:
        reason = error.strerror or error
        raise ViewError(
            f"cannot serve a page at {host}:{port}: {reason}; choose another --port, "
            "or 0 for any that is free"
        ) from None
