"""A record in the browser: the robot, scrubbed through, beside plots of CoM and ZMP."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from threading import Event, Lock
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from ..pattern import FootstepPlan
from ..runs import Moment, RunData, moved_steps
from .page_server import open_server
from .scene import COLORS, SEEN_THROUGH, Stage, show_row
from .scene_data import scene_of

if TYPE_CHECKING:
    import viser

FRAMES = 30.0
"""Pictures that a page is sent per second, at most [1/s]."""

_PLOTS = 6.0  # times per second that plots are drawn [1/s]
_SPAN = 6.0  # time that plots show [s]
_SAMPLES = 40.0  # points of a plot per second [1/s]
_NAMES = ("CoM", "CoM reference", "ZMP", "ZMP reference")


@contextmanager
def open_page(host: str, port: int) -> Generator[viser.ViserServer]:
    """Open a page's server, its panel docked on the right.

    Args:
        host: Address to listen at.
        port: Port; 0 for any that is free.

    Yields:
        The server.

    Raises:
        ViewError: If the port is in use, or the address is not this machine's.
    """
    with open_server(host, port) as server:
        server.gui.configure_theme(
            show_logo=False, show_share_button=False, control_width="large"
        )
        server.gui.main_panel.dock_right()
        yield server


def address_of(server: viser.ViserServer) -> str:
    """Return the address of a page.

    Args:
        server: Its server.

    Returns:
        The address.
    """
    host = server.get_host()
    shown = "127.0.0.1" if host in ("0.0.0.0", "::") else host
    shown = f"[{shown}]" if ":" in shown else shown
    return f"http://{shown}:{server.get_port()}"


class Plots:
    """CoM and ZMP beside their references over the last seconds. Final."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Add the plots to the panel.

        Args:
            server: Whose panel.
        """
        series: list[Any] = [{"label": "s"}]
        for name in _NAMES:
            dash = {"dash": [5, 4]} if "reference" in name else {}
            color = "rgb({},{},{})".format(*COLORS[name])
            series.append({"label": name, "stroke": color, "width": 1.5, **dash})
        nothing = (np.zeros(1),) * len(series)
        self._next = 0.0
        self._charts = [
            server.gui.add_uplot(
                nothing,
                tuple(series),
                title=f"{axis} [m]",
                scales={"x": {"time": False}},
                axes=({}, {"size": 60}),
                height=210,
            )
            for axis in "xy"
        ]

    def show(self, t: np.ndarray, values: np.ndarray, *, now: bool = False) -> None:
        """Draw the plots, if it is time to.

        Args:
            t: Times [s], of shape (n,).
            values: CoM, its reference, ZMP and its reference [m], of shape (n, 4, 2).
            now: Whether to draw at once.
        """
        clock = time.perf_counter()
        if len(t) < 2 or (clock < self._next and not now):
            return
        self._next = clock + 1.0 / _PLOTS
        for k, chart in enumerate(self._charts):
            rows = np.round(values[:, :, k].T, 5)
            chart.data = (t.copy(), *(np.ascontiguousarray(row) for row in rows))


class Display:
    """The scene, what of it is shown, and the plots. Final."""

    def __init__(
        self,
        server: viser.ViserServer,
        model: mujoco.MjModel,
        qpos: np.ndarray,
        plan: FootstepPlan | None,
    ) -> None:
        """Build scene and panel.

        Args:
            server: Where.
            model: The compiled scene.
            qpos: Where the robot stands at first.
            plan: Footsteps to draw.
        """
        self.follow = True
        """Whether the robot stays where the camera looks."""
        with server.gui.add_folder("CoM and ZMP", expand_by_default=True):
            self.plots = Plots(server)
        self.stage = Stage(server, model, qpos, plan, opacity=SEEN_THROUGH)
        with server.gui.add_folder("Show", expand_by_default=False):
            self._add_controls(server)

    def _add_controls(self, server: viser.ViserServer) -> None:
        """Add what hides and shows parts of the scene."""
        follow = server.gui.add_checkbox("follow the robot", self.follow)
        follow.on_update(lambda _: setattr(self, "follow", follow.value))
        opacity = server.gui.add_slider("opacity", 0.1, 1.0, 0.05, SEEN_THROUGH)
        opacity.on_update(lambda _: self.stage.opaque(opacity.value))
        for name, layer in self.stage.layers.items():
            box = server.gui.add_checkbox(name, True)
            box.on_update(_switch(layer, box))


def _switch(layer: Any, box: Any) -> Callable[[Any], None]:
    return lambda _: setattr(layer, "visible", box.value)


# ---- Records ----------------------------------------------------------------------


class Player:
    """Plays a record in a page, as fast as its buttons say. Final."""

    def __init__(self, server: viser.ViserServer, run: RunData) -> None:
        """Build the page.

        Args:
            server: Where.
            run: The record.
        """
        gui, self._data = server.gui, run
        self._lock, self._moved = Lock(), Event()
        self._start, self._stop = float(run.t[0]), float(run.t[-1])
        self.time, self.playing, self.speed = self._start, True, 1.0
        self._button = gui.add_button("Pause")
        self._slider = gui.add_slider("time [s]", 0.0, self._stop, 0.01, self._start)
        speeds = ("0.1", "0.25", "0.5", "1", "2")
        speed = gui.add_dropdown("speed", speeds, initial_value="1")
        self._status = gui.add_markdown("")
        qpos = run.columns["qpos"][0]
        self._display = Display(server, scene_of(run), qpos, run.plan)
        if run.plan is not None:
            moved = moved_steps(run.columns, run.plan)
            self._display.stage.draw_moved(moved, run.plan)
        self._button.on_click(lambda _: self.play(not self.playing))
        self._slider.on_update(self._scrubbed)
        speed.on_update(lambda _: setattr(self, "speed", float(speed.value)))
        self._shown: tuple[int, bool] | None = None

    def play(self, on: bool) -> None:
        """Play on, or pause.

        Args:
            on: Whether to play; at the end it plays from the start.
        """
        if on and self.time >= self._stop:
            self.time = self._start
        self.playing, self._button.label = on, "Pause" if on else "Play"
        self._moved.set()

    def _scrubbed(self, event: Any) -> None:
        """Go to the time that a hand moved the slider to."""
        if event.client is not None:
            self.play(False)
            self.time = float(self._slider.value)
            self._moved.set()

    def run(self, over: Callable[[], bool] | None = None) -> None:
        """Play until it is over, or the user interrupts.

        Args:
            over: Returns whether to stop; never if None.
        """
        last = time.perf_counter()
        while over is None or not over():
            now = time.perf_counter()
            if self.playing:
                self.time = min(self.time + (now - last) * self.speed, self._stop)
                self._slider.value = round(self.time, 2)
                if self.time >= self._stop:
                    self.play(False)
            last = now
            self._show()
            self._moved.wait(1.0 / FRAMES if self.playing else 0.1)
            self._moved.clear()

    def _show(self) -> None:
        """Show the row of the time, if it is not shown."""
        run, display = self._data, self._display
        row = run.row(self.time)
        if (row, display.follow) == self._shown:
            return
        self._shown = row, display.follow
        show_row(display.stage, run, row, display.follow)
        self._status.content = status_of(run.moment(row), self._step_at(row))
        rows = self._plotted(row)
        c = run.columns
        columns = run.com, c["com_ref"], c["zmp_filtered"], c["zmp_ref"]
        values = np.stack([column[rows, :2] for column in columns], axis=1)
        display.plots.show(run.t[rows], values, now=not self.playing)

    def _step_at(self, row: int) -> int:
        steps = self._data.columns.get("step")
        return 0 if steps is None else int(steps[row])

    def _plotted(self, row: int) -> np.ndarray:
        t = self._data.t
        step = max(1, round(1.0 / (_SAMPLES * float(np.diff(t[:2]).sum() or 1.0))))
        first = int(np.searchsorted(t, t[row] - _SPAN))
        return np.arange(first, row + 1, step)


def status_of(moment: Moment, step: int) -> str:
    """Return the status of a walk on one line.

    Args:
        moment: What there is to see.
        step: Footsteps that have landed.

    Returns:
        Time, phase, step and errors.
    """
    phase = moment.phase.name.lower().replace("_", " ")
    com = 1e3 * math.dist(moment.com[:2], moment.com_ref[:2])
    zmp = 1e3 * math.dist(moment.zmp, moment.zmp_ref)
    return (
        f"**{moment.time:.2f} s**, {phase}, step {step}; "
        f"CoM error {com:.1f} mm, ZMP error {zmp:.1f} mm"
    )


@contextmanager
def open_player(
    run: RunData, host: str = "127.0.0.1", port: int = 0
) -> Generator[tuple[Player, str]]:
    """Open a page that plays a record.

    Args:
        run: The record.
        host: Address to listen at.
        port: Port; 0 for any that is free.

    Yields:
        The player, whose `run` plays, and the page's address.

    Raises:
        ViewError: If the port is in use, or the address is not this machine's.
    """
    with open_page(host, port) as server:
        yield Player(server, run), address_of(server)
