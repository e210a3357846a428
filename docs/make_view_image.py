"""Photograph the page of a live walk: `python docs/make_view_image.py [FILE]`.

Needs playwright and Debian's chromium.
"""

from __future__ import annotations

import argparse
import io
import shutil
import time
from pathlib import Path
from threading import Thread

from PIL import Image
from playwright.sync_api import sync_playwright

from comwalk.cli import LiveWalk, open_live_page
from comwalk.config import WalkConfig
from comwalk.setup import build_walk
from comwalk.walking import build_scene

FLAGS = "--no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader"
MOMENT = 7.15
"""When the walk is paused for the picture [s]."""


def photograph(address: str, live: LiveWalk) -> Image.Image:
    """Return a picture of the page, paused in the middle of a step."""
    with sync_playwright() as play:
        chromium = shutil.which("chromium")
        browser = play.chromium.launch(executable_path=chromium, args=FLAGS.split())
        page = browser.new_page(viewport={"width": 1280, "height": 1000})
        page.goto(address)
        page.get_by_text("Pause", exact=True).first.wait_for(timeout=90e3)
        live.restart()
        while live.latest is None or live.latest.walk < 2:
            time.sleep(0.01)
        while live.latest.moment.time < MOMENT:
            time.sleep(0.001)
        live.pause(True)
        page.get_by_text("paused").wait_for(timeout=90e3)
        page.locator(".mantine-Notification-closeButton").first.click(timeout=90e3)
        time.sleep(15.0)  # without a graphics card, drawing is behind
        shot = page.screenshot(timeout=120e3)
        browser.close()
    return Image.open(io.BytesIO(shot)).convert("RGB")


def main() -> None:
    """Make the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    default = Path(__file__).parent / "images" / "live.webp"
    parser.add_argument("file", nargs="?", type=Path, default=default)
    file = parser.parse_args().file
    config = WalkConfig(steps=12)
    live = LiveWalk(build_walk(config))
    scene = build_scene(live.robot, live.setup.physics)
    thread = Thread(target=live.run, daemon=True)
    with open_live_page(live, scene, config) as address:
        thread.start()
        picture = photograph(address, live)
        live.quit()
        thread.join()
    picture.save(file, quality=82, method=6)
    print(f"{file.stat().st_size / 1e3:.0f} kB  {file}")


if __name__ == "__main__":
    main()
