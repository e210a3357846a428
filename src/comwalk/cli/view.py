"""The command `comwalk view`, and `comwalk walk --view`: pages in the browser."""

from __future__ import annotations

import sys
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from ..config import RobotConfig, WalkConfig
from ..errors import ViewError
from ..run import Run, plain
from ..setup import Setup
from ..views import HOST, PORT, Address, model_with_meshes, open_player, seen_of
from ..walking import build_scene
from .live import LiveWalk
from .live_page import open_live_page
from .options import HostFlag, OpenFlag, PortFlag


def view(
    run: Annotated[Path, Parameter(help="Folder of a run.")],
    /,
    *,
    host: HostFlag = HOST,
    port: PortFlag = PORT,
    open: OpenFlag = False,
) -> int:
    """Look at a run in the browser: scrub through it, with CoM and ZMP beside.

    It is served until Ctrl-C.
    """
    recording = seen_of(run, geometry=True)
    if open:
        check_browser()
    with open_player(recording, host, port) as (player, address):
        announce(address, open)
        try:
            player.run()
        except KeyboardInterrupt:
            return 0
    return 0


def walk_in_page(
    settings: RobotConfig, setup: Setup, about: Mapping[str, Any], where: Address
) -> Run:
    """Walk in real time, steered from a page, until its end or Ctrl-C.

    Args:
        settings: What was asked for.
        setup: What walks.
        about: More to say about the run.
        where: Where the page is served.

    Returns:
        The last walk.

    Raises:
        ComwalkError: If the page cannot be served, or the robot cannot walk so.
    """
    if not isinstance(settings, WalkConfig):
        raise ViewError("only a walk can be steered from a page")
    if where.open:
        check_browser()
    live = LiveWalk(setup, about)
    made = {"config": about["config"], "physics": plain(setup.physics)}
    plan = setup.pattern.plan
    bare = build_scene(live.robot, setup.physics, plan)
    model = model_with_meshes(bare, made, plan)
    with open_live_page(live, model, settings, where.host, where.port) as address:
        announce(address, where.open)
        return live.run()


def check_browser() -> None:
    """Refuse to open a browser where there is none.

    Raises:
        ViewError: If there is none.
    """
    try:
        webbrowser.get()
    except webbrowser.Error:
        raise ViewError(
            "no browser is found on this machine; leave out --open, and open the "
            "address that is printed where there is one"
        ) from None


def announce(address: str, open_it: bool) -> None:
    """Tell where the page is.

    Args:
        address: The page's address.
        open_it: Whether to open it here.
    """
    print(f"open {address} in a browser; Ctrl-C ends it", file=sys.stderr, flush=True)
    if open_it:
        webbrowser.open(address)
