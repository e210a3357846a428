"""The command line: commands, flags, tables, live page."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .app import main as main
    from .figures import draw_figures as draw_figures
    from .live import LiveWalk as LiveWalk
    from .live_page import open_live_page as open_live_page

__getattr__, __dir__ = exports_of(__name__, __file__)
