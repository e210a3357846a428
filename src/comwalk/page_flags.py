"""The flags of all commands that serve a page."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

HostFlag = Annotated[
    str, Parameter(help="Address to serve a page at; 0.0.0.0 for other machines too.")
]
"""`--host`."""

PortFlag = Annotated[int, Parameter(help="Port of a page; 0 for any that is free.")]
"""`--port`."""

OpenFlag = Annotated[
    bool, Parameter(help="Open a page in this machine's browser.", negative=())
]
"""`--open`."""
