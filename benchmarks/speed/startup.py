"""How long it takes until something happens, in new processes, cold and warm.

Cold means that no compiled kernel is kept on disk; Python's own bytecode and the files
in the operating system's memory are there in both.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

_FIRST_STEP = """
import os, sys, time
from comwalk.walking import MujocoLink
def read(link):
    print(time.time() - float(sys.argv[1]), time.process_time())
    sys.stdout.flush()
    os._exit(0)
MujocoLink.read = read
from comwalk.cli import main
main(["walk", *sys.argv[2:]])
"""
_WHOLE = """
import comwalk, sys, time
print(time.time() - float(sys.argv[1]), time.process_time())
"""
_HELP = """
import io, sys, time
from contextlib import redirect_stdout
from comwalk.cli import main
with redirect_stdout(io.StringIO()):
    main(["--help"])
print(time.time() - float(sys.argv[1]), time.process_time())
"""

ROWS = {
    "`import comwalk`": (_WHOLE, ()),
    "`comwalk --help`": (_HELP, ()),
    "`comwalk walk`, to the first physics step": (_FIRST_STEP, ()),
    "`comwalk walk g1`, to the first physics step": (_FIRST_STEP, ("g1",)),
    "`comwalk walk --steps 100`, the same": (_FIRST_STEP, ("--steps", "100")),
}


def startup(repeats: int) -> list[dict[str, object]]:
    """Return for each row seconds from the start of the process, cold and warm.

    `computing` is the processor time of the warm ones, which neighbours disturb less.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, (code, words) in ROWS.items():
            kernels = Path(folder) / str(len(rows))
            cold, _ = _seconds(code, words, kernels)
            warm = [_seconds(code, words, kernels) for _ in range(repeats)]
            wall, computing = (statistics.median(x) for x in zip(*warm, strict=True))
            row = {"name": name, "cold": cold, "warm": wall, "computing": computing}
            rows.append(row)
    return rows


def environment(kernels: Path) -> dict[str, str]:
    """Return an environment whose compiled kernels are kept in a folder."""
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return {**kept, "NUMBA_CACHE_DIR": str(kernels), "OMP_NUM_THREADS": "1"}


def _seconds(code: str, words: tuple[str, ...], kernels: Path) -> tuple[float, float]:
    """Return what a new process prints last: seconds by the clock, and computing."""
    with tempfile.TemporaryDirectory() as out:
        more = [*words, "--out", out] if code is _FIRST_STEP else []
        program, variables = [sys.executable, "-c", code], environment(kernels)
        done = subprocess.run(
            [*program, str(time.time()), *more],
            capture_output=True,
            text=True,
            check=True,
            env=variables,
        )
    wall, computing = done.stdout.split()[-2:]
    return float(wall), float(computing)
