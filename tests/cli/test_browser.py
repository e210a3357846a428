"""Pages in a real browser: they show the robot, and their controls do what they say."""

from __future__ import annotations

import io
import shutil
import time
from threading import Event, Thread

import numpy as np
import pytest
from PIL import Image

from comwalk.cli.live import LiveWalk
from comwalk.cli.live_page import open_live_page
from comwalk.config import Given, WalkConfig
from comwalk.pattern.footsteps import Gait
from comwalk.setup import build_walk
from comwalk.views.scene import scene_page
from comwalk.views.scene_data import seen_of
from comwalk.views.viewer import open_player
from comwalk.walking.mujoco_scene import build_scene

playwright = pytest.importorskip(
    "playwright.sync_api", reason="pip install 'comwalk[test]' brings playwright"
)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="there is no chromium on this machine"
)
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-quic",
)
PATIENCE = 90.0  # a browser without a graphics card on a busy machine [s]


@pytest.fixture(scope="module")
def browser():
    """Chromium without a window."""
    with playwright.sync_playwright() as play:
        chromium = play.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield chromium
        chromium.close()


@pytest.fixture
def open_tab(browser):
    """Return what opens an address in a tab that has nothing but this machine."""
    tabs = []

    def open_it(address):
        tab = browser.new_page(viewport={"width": 900, "height": 560})
        tab.set_default_timeout(1e3 * PATIENCE)
        outside = []
        tab.on("request", lambda request: outside.append(request.url))
        tab.goto(address)
        tabs.append((tab, outside))
        return tab

    yield open_it
    for tab, outside in tabs:
        tab.close()
        own = ("http://127.0.0.1", "ws://127.0.0.1", "file:", "data:", "blob:")
        assert [url for url in outside if not url.startswith(own)] == []


def wait_for(condition):
    """Wait until something holds, and return it."""
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.1)
    return found


def picture_of(tab):
    """Return the left half of a tab, where the robot is, as numbers."""
    shot = tab.screenshot(
        timeout=1e3 * PATIENCE, clip={"x": 100, "y": 60, "width": 420, "height": 420}
    )
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)


def shows_robot(tab):
    """Return whether there is the robot's dark grey, more than lines have."""
    pixels = picture_of(tab)
    grey = np.ptp(pixels, axis=2) < 30
    return bool((grey & (pixels.max(axis=2) < 190)).mean() > 0.005)


@pytest.fixture(scope="module")
def recording():
    """Three steps of a walk."""
    gait = Given(Gait, {"stand_time": 0.2, "start_time": 0.5, "stop_time": 0.5})
    return seen_of(build_walk(WalkConfig(gait=gait, steps=3)).run())


def test_an_exported_page_plays_from_disk(recording, open_tab, tmp_path):
    """With the network off: robot, play bar, and the moment that is clicked."""
    file = tmp_path / "page.html"
    file.write_text(scene_page(recording, fps=15.0), encoding="utf-8")
    tab = open_tab(file.as_uri())
    tab.context.set_offline(True)
    bar = tab.locator(".mantine-Slider-track").first
    bar.wait_for()
    wait_for(lambda: shows_robot(tab))
    box = bar.bounding_box()
    tab.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + box["height"] / 2)
    clock = tab.locator("input").first
    wanted = 0.75 * float(recording.t[-1])
    wait_for(lambda: abs(float(clock.input_value()) - wanted) < 0.3)


def test_a_run_is_scrubbed(recording, open_tab):
    """It plays by itself; the time that is typed is shown, and play goes on."""
    over = Event()
    with open_player(recording) as (player, address):
        thread = Thread(target=player.run, args=(over.is_set,), daemon=True)
        thread.start()
        tab = open_tab(address)
        tab.get_by_role("button", name="Pause").or_(
            tab.get_by_role("button", name="Play")
        ).first.wait_for()
        player.play(False)
        entry = tab.locator("input[type=text]:visible").first
        entry.fill("2.5")
        entry.press("Enter")
        wait_for(lambda: abs(player.time - 2.5) < 1e-6 and not player.playing)
        wait_for(lambda: tab.get_by_text("2.50 s").count())
        wait_for(lambda: shows_robot(tab))
        tab.get_by_role("button", name="Play").click()
        wait_for(lambda: player.time != 2.5)
        over.set()
        thread.join(timeout=10.0)


def test_a_live_walk_is_steered(open_tab):
    """Robot, gains that move the controller, gains that are refused, a push, pause."""
    gait = Given(Gait, {"stand_time": 0.2, "start_time": 0.5, "stop_time": 0.5})
    config = WalkConfig(gait=gait, steps=2)
    live = LiveWalk(build_walk(config))
    scene = build_scene(live.robot, live.setup.physics)
    runs = []
    thread = Thread(target=lambda: runs.append(live.run()), daemon=True)
    with open_live_page(live, scene, config) as address:
        thread.start()
        try:
            steer(live, open_tab(address))
        finally:
            live.quit()
            thread.join(timeout=30.0)
    assert runs[0].outcome.ok


def steer(live, tab):
    """Use the controls of a live page one after the other."""
    gains = live.setup.control.gains
    entries = tab.locator("input[type=text]:visible")
    wait_for(lambda: entries.count() > 4)
    k_p_x = entries.nth(1)  # after the speed
    k_p_x.fill("2.5")
    k_p_x.press("Enter")
    wait_for(lambda: live.latest.gains.zmp == (2.5, gains.zmp[1]))
    k_p_x.fill("9")
    k_p_x.press("Enter")
    tab.get_by_text("refused").wait_for()
    wait_for(lambda: float(k_p_x.input_value()) == 2.5)
    assert live.latest.gains.zmp == (2.5, gains.zmp[1])
    wait_for(lambda: tab.get_by_text("survives").count())

    wait_for(lambda: live.latest.outcome)  # it stands, and goes on standing
    assert live.latest.outcome.ok
    y = live.latest.moment.com[1]
    tab.get_by_role("button", name="Push", exact=True).click()
    wait_for(lambda: live.latest.moment.com[1] - y > 2e-3)

    tab.get_by_text("Pause", exact=True).first.click()
    wait_for(lambda: live.paused)
    wait_for(lambda: shows_robot(tab))
    tab.get_by_text("Restart", exact=True).first.click()
    wait_for(lambda: live.latest.walk == 2)
    if live.paused:
        tab.get_by_text("Pause", exact=True).first.click()
    wait_for(lambda: live.latest.outcome)
