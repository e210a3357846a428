"""Figures, pages, 3-D scenes, films and the viewer of a run."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .gain_plane import plot_gain_plane as plot_gain_plane
    from .gain_plane import plot_identified as plot_identified
    from .gl import choose_backend as choose_backend
    from .matplotlib_figures import Row as Row
    from .matplotlib_figures import plot_arms as plot_arms
    from .matplotlib_figures import plot_dance as plot_dance
    from .matplotlib_figures import plot_run as plot_run
    from .page import WebPage as WebPage
    from .page import notebook_html as notebook_html
    from .page import report as report
    from .page_server import HOST as HOST
    from .page_server import PORT as PORT
    from .page_server import Address as Address
    from .pattern_figure import plot_pattern as plot_pattern
    from .portrait import draw_portrait as draw_portrait
    from .render import View as View
    from .render import render_run as render_run
    from .render import render_still as render_still
    from .render import still as still
    from .scene_data import model_with_meshes as model_with_meshes
    from .scene_data import scene_of as scene_of
    from .scene_data import seen_of as seen_of
    from .video import STILLS as STILLS
    from .video import check_film as check_film
    from .viewer import FRAMES as FRAMES
    from .viewer import Display as Display
    from .viewer import address_of as address_of
    from .viewer import open_page as open_page
    from .viewer import open_player as open_player
    from .viewer import status_of as status_of

__getattr__, __dir__ = exports_of(__name__, __file__)
