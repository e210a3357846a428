"""Make all pictures of the documentation: `python docs/make_images.py [FOLDER]`.

Draws the paper's figures, and films a walk and a dance, into docs/images.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from pathlib import Path

from comwalk.views import choose_backend

choose_backend()  # before anything imports mujoco

from comwalk.cli import draw_figures
from comwalk.config import CertifyConfig, DanceConfig, Given, WalkConfig
from comwalk.pattern import Gait
from comwalk.setup import build_certificate, build_dance, build_walk
from comwalk.views import View, plot_gain_plane, render_run, still

FILM = View(width=480, height=432, shadows=True, smooth=2, distance=1.6)
"""Camera of the animations."""
PORTRAIT = View(
    width=720, height=900, shadows=True, smooth=3, distance=1.4, overlays=False
)
"""Camera of the portrait."""


def film_walk(folder: Path) -> None:
    """Film six steps, and take the robot's portrait before the first one.

    It stands until the arms, which swing from 0.2 s on, are in time with the legs.
    """
    walk = WalkConfig(
        gait=Given(Gait, {"stand_time": 1.6}),
        steps=6,
        motion="swing",
        motion_amplitude=0.4,
    )
    run = build_walk(walk).run()
    if run.scene is None or not run.outcome.ok:
        raise SystemExit(f"the walk is not fit to be shown: {run.outcome}")
    render_run(
        run, folder / "walk.webp", view=FILM, start=1.9, stop=10.6, fps=14.0, quality=62
    )
    still(run.scene, run.log["qpos"][0], folder / "robot.png", view=PORTRAIT)


def draw_gains(folder: Path) -> None:
    """Draw the plane of the gains for the robot `paper`."""
    certificate = build_certificate(CertifyConfig(exact=False))
    plot_gain_plane(certificate, folder / "gains.png", title="paper")


def film_dance(folder: Path) -> None:
    """Film two cycles of a dance, so that the film loops without a jump."""
    setup = build_dance(DanceConfig(amplitude=1.2, frequency=0.5, duration=10.0))
    run = setup.run()
    view = dataclasses.replace(FILM, azimuth=math.radians(20.0), overlays=False)
    start, cycles = 3.2, 4.0 - 1.0 / 14.0
    target = folder / "dance.webp"
    render_run(
        run, target, view=view, start=start, stop=start + cycles, fps=14.0, quality=62
    )


def main() -> None:
    """Make the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    default = Path(__file__).parent / "images"
    parser.add_argument("folder", nargs="?", type=Path, default=default)
    folder = parser.parse_args().folder
    draw_figures(folder, print)
    draw_gains(folder)
    print("filming the walk")
    film_walk(folder)
    print("filming the dance")
    film_dance(folder)
    for file in sorted(folder.iterdir()):
        print(f"{file.stat().st_size / 1e6:6.2f} MB  {file}")


if __name__ == "__main__":
    main()
