"""The page of a live walk: gains and gait, pushes, the certificate, plots."""

from __future__ import annotations

import dataclasses
import math
import re
import time
from collections import deque
from collections.abc import Generator
from contextlib import contextmanager
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from ..certificates import (
    certify,
    sampled_loop_of,
    servo_lag_of,
    sole_room,
    stance_ratio,
)
from ..config import Given, WalkConfig
from ..control import Gains
from ..errors import ComwalkError
from ..pattern import Gait
from ..setup import Setup, build_walk, regular_gait
from ..views import FRAMES, Display, address_of, open_page, status_of
from .live import LiveView, LiveWalk

if TYPE_CHECKING:
    import viser

PUSHES = {
    "forward": 0.0,
    "left": 0.5 * math.pi,
    "backward": math.pi,
    "right": -0.5 * math.pi,
}
"""Where pushes go to: angles from the walking direction, left positive [rad]."""

_HISTORY = 6.0  # time that plots and paths show [s]
_FOLLOW = 0.7  # time constant of what the camera looks at [s]
_STATUS = 4.0  # times per second that words are written [1/s]


class LivePage:
    """The page of a live walk: views and controls. Final."""

    def __init__(
        self,
        server: viser.ViserServer,
        live: LiveWalk,
        model: mujoco.MjModel,
        config: WalkConfig,
    ) -> None:
        """Build the page.

        Args:
            server: Where.
            live: The walk.
            model: A scene of its robot to look at, with meshes.
            config: What the walk was made of; a changed gait makes another.
        """
        self.server, self.live = server, live
        self._config = config
        self._over, self._new_gains = Event(), Event()
        self._walk, self._words_at, self._moved = 0, 0.0, 0
        self._rows: deque[tuple[float, np.ndarray]] = deque()
        setup, gui = live.setup, server.gui
        self._robot = robot = live.robot
        self._center = robot.home[:2].copy()
        self._status = gui.add_markdown("")
        self._message = gui.add_markdown("", visible=False)
        self._add_run()
        with gui.add_folder("Gains"):
            self._add_gains(setup.control.gains)
        with gui.add_folder("Push"):
            self._add_push()
        with gui.add_folder("Gait", expand_by_default=False):
            self._add_gait()
        self._display = Display(server, model, robot.home, setup.pattern.plan)
        self._threads = [
            Thread(target=loop, daemon=True, name=f"comwalk {loop.__name__}")
            for loop in (self._keep_showing, self._keep_certifying)
        ]

    def start(self) -> None:
        """Begin to show."""
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Show nothing more."""
        self._over.set()
        self._new_gains.set()
        for thread in self._threads:
            thread.join(timeout=5.0)

    # ---- Controls -----------------------------------------------------------------

    def _add_run(self) -> None:
        """Add pause, step, restart, speed and the end."""
        gui, live = self.server.gui, self.live
        does = {
            "Pause": lambda: live.pause(not live.paused),
            "Step": live.advance,
            "Restart": self._restart,
            "End": live.quit,
        }
        hint = "Pause or go on; step 0.02 s in a pause; walk again; end and save."
        buttons = gui.add_button_group("walk", tuple(does), hint=hint)
        buttons.on_click(lambda event: does[event.target.value]())
        speed = gui.add_slider("speed", 0.1, 1.0, 0.1, 1.0)
        speed.on_update(lambda _: live.go_at(float(speed.value)))

    def _add_gains(self, gains: Gains) -> None:
        """Add a slider for each gain, and the certificate's verdict."""
        gui = self.server.gui
        self._sliders: dict[str, Any] = {}
        for key, label in (("zmp", "k_p"), ("com", "k_c")):
            values = getattr(gains, key)
            high = max(10.0, 2.0 * math.ceil(max(values)))
            for axis, value in zip("xy", values, strict=True):
                slider = gui.add_slider(
                    f"{label} {axis}", 0.0, high, 0.05, round(value, 2)
                )
                slider.on_update(self._gain_moved)
                self._sliders[f"{key}_{axis}"] = slider
        self._verdict = gui.add_markdown("")
        self._new_gains.set()

    def _gain_moved(self, event: Any) -> None:
        """Give the moved gains to the controller, or put the sliders back."""
        if event.client is None:  # put back by the program
            return
        at = {name: float(slider.value) for name, slider in self._sliders.items()}
        gains = dataclasses.replace(
            self.live.setup.control.gains,
            zmp=(at["zmp_x"], at["zmp_y"]),
            com=(at["com_x"], at["com_y"]),
        )
        try:
            self.live.set_gains(gains)
        except ComwalkError as error:
            self._say(f"refused: {error}")
            self._put_back()
            return
        self._say("")
        self._new_gains.set()

    def _put_back(self) -> None:
        """Set the sliders to the gains that the controller has."""
        gains = self.live.setup.control.gains
        for key in ("zmp", "com"):
            for axis, value in zip("xy", getattr(gains, key), strict=True):
                self._sliders[f"{key}_{axis}"].value = round(value, 2)

    def _add_push(self) -> None:
        """Add direction, impulse and the button that pushes."""
        gui, mass = self.server.gui, self._robot.mass
        way = gui.add_dropdown("direction", tuple(PUSHES), initial_value="left")
        high = float(math.ceil(0.5 * mass))
        usual = min(high, float(round(0.12 * mass)))
        impulse = gui.add_slider("impulse [N s]", 0.0, high, 0.5, usual)
        button = gui.add_button("Push", hint="Push the trunk for 0.1 s.")
        button.on_click(
            lambda _: self.live.push(PUSHES[way.value], float(impulse.value))
        )

    def _add_gait(self) -> None:
        """Add sliders for the gait of the next walk."""
        gui, config = self.server.gui, self._config
        self._gait_sliders: dict[str, Any] = {}
        if config.plan is not None:
            gui.add_markdown("The footsteps are those of the plan.")
            return
        gait = regular_gait(config, self._robot)
        gui.add_markdown("Takes effect at **Restart**.")
        for key, label, low, high, step, value in (
            ("steps", "steps", 1, 100, 1, min(config.steps, 100)),
            ("length", "step length [m]", -0.4, 0.4, 0.01, gait.step_length),
            ("period", "step time [s]", 0.3, 2.0, 0.01, gait.period),
            ("turn", "turn per step [deg]", -30.0, 30.0, 1.0, math.degrees(gait.turn)),
        ):
            slider = gui.add_slider(label, low, high, step, round(value, 3))
            self._gait_sliders[key] = slider
        self._gait = gait

    def _restart(self) -> None:
        """Walk anew, with the gait of the sliders if it was changed."""
        try:
            self.live.restart(self._new_setup())
        except ComwalkError as error:
            self._say(f"refused: {error}")
        else:
            self._say("")

    def _new_setup(self) -> Setup | None:
        """Return the walk that the sliders ask for; None for the same as before."""
        if not self._gait_sliders:
            return None
        at = {name: slider.value for name, slider in self._gait_sliders.items()}
        changed: dict[str, float] = {}
        for key, value, old in (
            ("half_step", 0.5 * at["length"], self._gait.half_step),
            ("period", at["period"], self._gait.period),
            ("turn", math.radians(at["turn"]), self._gait.turn),
        ):
            if not math.isclose(value, old, abs_tol=2e-3):
                changed[key] = value
        if not changed and at["steps"] == self._config.steps:
            return None
        given = {f.name: getattr(self._gait, f.name) for f in dataclasses.fields(Gait)}
        config = dataclasses.replace(
            self._config,
            steps=int(at["steps"]),
            speed=None,
            side=None,
            turn=None,
            gait=Given(Gait, {**given, **changed}),
        )
        setup = build_walk(config)
        control = self.live.setup.control
        return dataclasses.replace(setup, control=control)

    def _say(self, text: str) -> None:
        """Show a message; none if the text is empty."""
        self._message.content = f"**{_as_it_is(text)}**" if text else ""
        self._message.visible = bool(text)

    # ---- Threads ------------------------------------------------------------------

    def _keep_showing(self) -> None:
        """Show the latest there is, at most `FRAMES` times a second."""
        shown = None
        while not self._over.wait(1.0 / FRAMES):
            seen = self.live.latest
            if seen is not None and seen is not shown:
                shown = seen
                self._show(seen)
            self._write(shown)

    def _show(self, seen: LiveView) -> None:
        """Show one moment."""
        moment = seen.moment
        if seen.walk != self._walk:
            self._walk = seen.walk
            self._rows.clear()
            self._center = moment.qpos[:2].copy()
            self._display.stage.draw_plan(self.live.setup.pattern.plan)
            self._moved = 0
        if len(seen.moved) != self._moved:
            self._moved = len(seen.moved)
            plan = self.live.setup.pattern.plan
            self._display.stage.draw_moved(seen.moved, plan)
        if self._rows and moment.time <= self._rows[-1][0]:
            self._rows = deque(row for row in self._rows if row[0] < moment.time)
        points = (moment.com[:2], moment.com_ref[:2], moment.zmp, moment.zmp_ref)
        elapsed = moment.time - self._rows[-1][0] if self._rows else 0.0
        self._rows.append((moment.time, np.stack(points)))
        while moment.time - self._rows[0][0] > _HISTORY:
            self._rows.popleft()
        share = 1.0 - math.exp(-elapsed / _FOLLOW)
        self._center = self._center + share * (moment.qpos[:2] - self._center)
        t = np.array([row[0] for row in self._rows])
        values = np.stack([row[1] for row in self._rows])
        center = self._center if self._display.follow else self._robot.home[:2]
        self._display.stage.show(moment, center, values[:, 0], values[:, 2])
        self._display.plots.show(t, values)

    def _write(self, seen: LiveView | None) -> None:
        """Write where the walk is, now and then."""
        now = time.perf_counter()
        if seen is None or now < self._words_at:
            return
        self._words_at = now + 1.0 / _STATUS
        words, pacer = status_of(seen.moment, seen.step), self.live.pacer
        if seen.outcome is not None:
            words += f"\n\n**{_as_it_is(str(seen.outcome))}**"
        if self.live.paused:
            words += "\n\n*paused*"
        else:
            late = 100.0 * pacer.late / max(pacer.ticks, 1)
            words += f"\n\n{pacer.real_time_factor:.2f} of real time, {late:.1f} % late"
        self._status.content = words

    def _keep_certifying(self) -> None:
        """Write what the gains of now guarantee, whenever they have changed."""
        room, stance = sole_room(self._robot), stance_ratio(self._robot)
        while True:
            self._new_gains.wait()
            self._new_gains.clear()
            if self._over.is_set():
                return
            setup = self.live.setup
            control, pendulum = setup.control, setup.pattern.pendulum
            certificate = certify(
                pendulum,
                control.gains,
                sampled_loop_of(control, servo_lag_of(self._robot, control.body)),
                room=room,
                stance=stance,
                exact=False,
            )
            self._verdict.content = certificate.verdict


@contextmanager
def open_live_page(
    live: LiveWalk,
    model: mujoco.MjModel,
    config: WalkConfig,
    host: str = "127.0.0.1",
    port: int = 0,
) -> Generator[str]:
    """Open the page of a live walk.

    Args:
        live: The walk; its `run` walks.
        model: A scene of its robot to look at, with meshes.
        config: What it was made of.
        host: Address to listen at.
        port: Port; 0 for any that is free.

    Yields:
        The page's address.

    Raises:
        ViewError: If the port is in use, or the address is not this machine's.
    """
    with open_page(host, port) as server:
        page = LivePage(server, live, model, config)
        page.start()
        try:
            yield address_of(server)
        finally:
            page.close()


def _as_it_is(text: str) -> str:
    """Return text, which may hold names from a file, without markup for Markdown."""
    return re.sub(r"([\\`*_{}\[\]<>&])", r"\\\1", text)
