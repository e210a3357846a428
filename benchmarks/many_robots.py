"""20 steps of every robot description in some folders, each at its own default.

    python benchmarks/many_robots.py [--write] FOLDER ...

A folder is a copy of a repository, or of a package's data. Files of parts, scenes and
worlds are told by what they hold, not by their names. `--write` puts the table into
docs/descriptions.md.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from comwalk.cli.app import main as comwalk

PAGE = Path(__file__).parent.parent / "docs" / "descriptions.md"
SUFFIXES = (".urdf", ".xml", ".mjcf", ".xacro")
_BODY = re.compile(r"<(link|body)\b")
_LEAST_BODIES = 12  # a robot with two legs has as many


def descriptions(folder: Path) -> Iterator[Path]:
    """Yield the files that may hold a whole robot."""
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in SUFFIXES and path.is_file():
            text = path.read_text(encoding="utf-8", errors="replace")
            makes = path.name.endswith(".urdf.xacro")
            if makes or len(_BODY.findall(text)) >= _LEAST_BODIES:
                yield path


def told(*words: str) -> tuple[int, str, str]:
    """Return exit code, output and errors of a command."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = comwalk(words)
    return code, out.getvalue(), err.getvalue()


def row(folder: Path, path: Path) -> tuple[str, ...]:
    """Return file, size, gait and outcome."""
    name = f"{folder.name}: {path.relative_to(folder).as_posix()}"
    code, text, error = told("robot", str(path), "--json")
    if code:
        return name, "", "", "", _short(error, path)
    facts = json.loads(text)
    gait = facts["gait"]
    size = f"{facts['mass_kg']:.1f}", f"{facts['com_height_m']:.2f}"
    with tempfile.TemporaryDirectory() as out:
        words = ("walk", str(path), "--steps", "20", "--json", "--out", out)
        code, text, error = told(*words)
    if code == 2:
        return name, *size, "", _short(error, path)
    s = json.loads(text)
    end = f"{s['outcome']}, {1e3 * s['position_error_m']:.0f} mm off"
    return name, *size, f"{gait['speed_m_s']:.2f}", end


def _short(error: str, path: Path) -> str:
    """Return an error without the path, for a cell."""
    text = error.strip().removeprefix("comwalk: ").replace(str(path), "it")
    return "refused: " + text.removeprefix("robot it: ").split(";")[0].replace("|", "/")


def main(words: list[str]) -> None:
    """Print the table, or write it."""
    folders = [Path(word).absolute() for word in words if word != "--write"]
    lines = ["| description | mass [kg] | CoM [m] | speed [m/s] | 20 steps |"]
    lines.append("|---|---|---|---|---|")
    for folder in folders:
        for path in descriptions(folder):
            lines.append(f"| {' | '.join(row(folder, path))} |")
            print(lines[-1], flush=True)
    ends = [line.rsplit(" | ", 1)[-1] for line in lines[2:]]
    counts = {
        word: sum(end.startswith(word) for end in ends)
        for word in ("completed", "refused", "fell")
    }
    total = ", ".join(f"{count} {word}" for word, count in counts.items())
    print(f"{len(ends)} descriptions: {total}")
    if "--write" in words:
        before = PAGE.read_text(encoding="utf-8").split("<!-- table -->")[0]
        text = "\n".join([f"{len(ends)} descriptions: {total}.\n", *lines])
        PAGE.write_text(f"{before}<!-- table -->\n{text}\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
