"""Write the table of results into the README: `python docs/make_results.py`.

Each row is a command; what it printed stands beside it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

SOFT = "walk --stiffness 0.25"
OPEN_LOOP = "--gains.zmp 0 --gains.com 0"
LEVEL = "--body.no-imu --body.landing 0"
ROUGH = "walk --simulator.terrain 0.01"
LOADED = "walk --simulator.payload 0.1"
REAL = (
    "--simulator.joint-friction 2 --simulator.noise 1 --simulator.latency 0.002 "
    "--simulator.command-delay 0.004"
)

ROWS = {
    "the paper's walk, 4 m": "walk",
    "the same, 20 m": "walk --steps 100",
    "the same in open loop": f"walk {OPEN_LOOP}",
    "servos at a quarter of the stiffness": SOFT,
    "the same in open loop (soft)": f"{SOFT} {OPEN_LOOP}",
    "the same, soles taken for level (soft)": f"{SOFT} {OPEN_LOOP} {LEVEL}",
    "boxes of up to 10 mm on the floor": ROUGH,
    "the same, soles taken for level (rough)": f"{ROUGH} {LEVEL}",
    "a tenth of its mass on the back": LOADED,
    "the same, not weighed before": f"{LOADED} --body.no-calibration",
    "encoder zeros off by 3 mrad": "walk --simulator.encoder-zero 0.003",
    "an IMU mounted askew by 5 mrad": "walk --simulator.imu-tilt 0.005",
    "dry friction of 2 N m, noise, 6 ms of delay": f"walk {REAL}",
    "twice as fast": "walk --speed 0.4 --steps 10",
    "backward": "walk --speed -0.2 --steps 10",
    "sideways": "walk --side 0.06 --steps 10",
    "a full turn in place": "walk --turn 18 --steps 20",
    "walking and dancing": "walk --motion disco --motion-frequency 1 --steps 10",
    "both arms dance": "dance",
    "the same, legs unaware": "dance --body.no-embed-motion",
    "both arms dance fast": "dance --frequency 1",
}
"""What each command shows, and the command."""

HEAD = """| run | `comwalk ...` | outcome | CoM error rms, true, x / y [mm] | ZMP error rms, x / y [mm] | sole margin, 5th percentile [mm] | largest ZMP deviation in a dance [mm] |
|---|---|---|---|---|---|---|
"""  # noqa: E501


def row(title: str, command: str) -> str:
    """Return a row of the table: run the command, read its summary."""
    program = [sys.executable, "-m", "comwalk", *command.split(), "--json"]
    with tempfile.TemporaryDirectory() as folder:
        result = subprocess.run(
            [*program, "--out", folder], capture_output=True, text=True, check=False
        )
    if result.returncode not in (0, 1):
        raise SystemExit(f"{command}: {result.stderr}")
    s = json.loads(result.stdout)
    com, zmp = s["com_error_rms_mm"]["true"], s["zmp_error_rms_mm"]
    standing = s["steps_planned"] == 0
    fell = s["outcome"] != "completed"
    outcome = f"{s['outcome']} at {s['time_s']:.1f} s" if fell else s["outcome"]
    margin = s["sole_margin_p5_mm"]
    cells = [
        title.partition(" (")[0],
        f"`{command}`",
        outcome,
        "-" if fell else f"{com['x']:.1f} / {com['y']:.1f}",
        "-" if fell else f"{zmp['x']:.1f} / {zmp['y']:.1f}",
        "-" if fell or margin is None else f"{margin:.0f}",
        f"{max(s['zmp_deviation_max_mm'].values()):.1f}" if standing else "-",
    ]
    return "| " + " | ".join(cells) + " |\n"


def main() -> None:
    """Replace what stands between the markers in the README."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    readme = Path(__file__).parent.parent / "README.md"
    before, rest = readme.read_text(encoding="utf-8").split("<!-- results -->\n")
    after = rest.split("<!-- /results -->")[1]
    table = HEAD
    for title, command in ROWS.items():
        line = row(title, command)
        print(line, end="", flush=True)
        table += line
    text = f"{before}<!-- results -->\n{table}<!-- /results -->{after}"
    readme.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
