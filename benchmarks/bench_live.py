"""How well a live walk keeps real time: `python benchmarks/bench_live.py [TABS ...]`.

Each word is one walk: a number of tabs that take all they are sent, or "stalled" for
two tabs that take nothing after the first picture. Tabs are processes of their own that
speak viser's protocol; a browser would also need a processor to draw.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from threading import Thread

import viser
from websockets.sync.client import connect

from comwalk.cli import LiveWalk, open_live_page
from comwalk.config import WalkConfig
from comwalk.setup import build_walk
from comwalk.walking import build_scene

WARM_UP, MEASURED = 3.0, 10.0  # [s]


def take(address: str, stalled: bool) -> None:
    """Be a tab: take what is sent, or stop to."""
    protocol = f"viser-v{viser.__version__}"
    with connect(
        address.replace("http", "ws"), subprotocols=[protocol], max_size=None
    ) as socket:
        while True:
            socket.recv()
            if stalled:
                time.sleep(3600.0)


def measure(robot: str, tabs: int, stalled: bool) -> tuple[float, float, float]:
    """Return the real-time factor, the share of late ticks and of a processor."""
    config = WalkConfig(robot=robot, steps=20)
    live = LiveWalk(build_walk(config))
    scene = build_scene(live.robot, live.setup.physics)
    thread = Thread(target=live.run, daemon=True)
    processes = multiprocessing.get_context("spawn")
    with open_live_page(live, scene, config) as address:
        lookers = [
            processes.Process(target=take, args=(address, stalled), daemon=True)
            for _ in range(tabs)
        ]
        for looker in lookers:
            looker.start()
        thread.start()
        time.sleep(WARM_UP)
        live.go_at(1.0)  # counts anew
        spent = time.process_time()
        time.sleep(MEASURED)
        pacer = live.pacer
        busy = (time.process_time() - spent) / MEASURED
        result = pacer.real_time_factor, pacer.late / pacer.ticks, busy
        live.quit()
        thread.join()
        for looker in lookers:
            looker.terminate()
    return result


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tabs", nargs="*", default=["0", "1", "2", "stalled"])
    parser.add_argument("--robot", default="paper")
    given = parser.parse_args()
    for word in given.tabs:
        stalled = word == "stalled"
        tabs = 2 if stalled else int(word)
        factor, late, busy = measure(given.robot, tabs, stalled)
        print(
            f"{word:>8} tabs: {factor:.3f} of real time, {100 * late:.2f} % of the "
            f"ticks a period late or more, {100 * busy:.0f} % of one processor"
        )


if __name__ == "__main__":
    main()
