"""The server of a page in the browser, and its errors."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import urlsplit

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
    with _silent_rich(), _guarded(host):
        server = viser.ViserServer(host=host, port=port, label="comwalk", verbose=False)
    try:
        yield server
    finally:
        with _silent_rich():
            server.stop()


def refusal(host: str, headers: Mapping[str, str]) -> str | None:
    """Return why a request is not answered: it comes from a page of another site.

    A page anywhere can make the browser of this machine ask for this one. The browser
    tells where it comes from (Origin), and by which name it reached the server (Host):
    another name than this machine's may have been pointed here on purpose.

    Args:
        host: The address that is listened at.
        headers: Of the request.

    Returns:
        The reason, None if it is answered.
    """
    name, origin = headers.get("Host", ""), headers.get("Origin")
    bare = urlsplit(f"//{name}").hostname or ""
    known = {"localhost", host.lower(), socket.gethostname().lower()}
    if bare not in known and not _is_address(bare):
        return f"this page is not {bare or 'without a name'}"
    if origin is not None and urlsplit(origin).netloc.lower() != name.lower():
        return f"this page is not for {origin}"
    return None


def _is_address(name: str) -> bool:
    """Return whether a name is an IP address, which nobody can point elsewhere."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


@contextmanager
def _guarded(host: str) -> Generator[None]:
    """Let a server that starts meanwhile refuse what comes from other sites.

    viser answers whoever asks, and hands nobody the requests: so the function is
    wrapped that it serves with.
    """
    import websockets.asyncio.server as module

    serve = module.serve

    def guarded(*args: Any, process_request: Any = None, **options: Any) -> Any:
        """Serve as before, after a look at each request."""

        def answer(connection: Any, request: Any) -> Any:
            """Refuse a request of another site, and pass on the others."""
            try:
                reason = refusal(host, request.headers)
            except ValueError as error:  # a header that is none
                reason = str(error)
            if reason is not None:
                return connection.respond(HTTPStatus.FORBIDDEN, f"{reason}\n")
            return process_request(connection, request) if process_request else None

        return serve(*args, process_request=answer, **options)

    names = vars(module)
    names["serve"] = guarded
    try:
        yield
    finally:
        names["serve"] = serve


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
