"""The command line: commands, flags, tables, live page."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .app import main as main

__getattr__, __dir__ = exports_of(__name__, __file__)
