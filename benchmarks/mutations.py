"""What spoilt robot files do: checked, walked if they can be, and counted by kind.

    python benchmarks/mutations.py [COUNT]

Each of five good files is spoilt COUNT times (60 if not given) in twelve ways: numbers
with another sign, unit or size, elements and attributes that are missing, wrong names.
Nothing may end in a traceback, and nothing that `comwalk check` accepts may fall.
"""

from __future__ import annotations

import random
import re
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from many_robots import told

from comwalk.errors import ModelError
from comwalk.robot.loaders.sources import read_model

ROBOTS = ("paper", "g1", "talos", "icub", "romeo")
STEPS = "6"
_NUMBERS = re.compile(r"^[\s\d.eE+-]+$")
_LENGTHS = ("xyz", "pos", "size", "length", "radius")
_PLACED = ("origin", "body", "geom", "site", "inertial", "joint", "box", "cylinder")
Spoil = Callable[[ET.Element, random.Random], None]


def numbers(root: ET.Element) -> list[tuple[ET.Element, str]]:
    """Return all attributes that hold numbers."""
    return [
        (element, key)
        for element in root.iter()
        for key, text in element.attrib.items()
        if text.strip() and _NUMBERS.match(text)
    ]


def one_number(change: Callable[[float], object]) -> Spoil:
    """Return what changes the numbers of one attribute."""

    def spoil(root: ET.Element, rng: random.Random) -> None:
        element, key = rng.choice(numbers(root))
        words = [str(change(float(x))) for x in element.attrib[key].split()]
        element.set(key, " ".join(words))

    return spoil


def all_lengths(factors: tuple[float, ...]) -> Spoil:
    """Return what makes the whole robot larger or smaller, but not its masses."""

    def spoil(root: ET.Element, rng: random.Random) -> None:
        factor = rng.choice(factors)
        for element, key in numbers(root):
            if element.tag in _PLACED and key in _LENGTHS:
                words = [str(factor * float(x)) for x in element.attrib[key].split()]
                element.set(key, " ".join(words))

    return spoil


def drop_element(root: ET.Element, rng: random.Random) -> None:
    """Remove any element."""
    parent, child = rng.choice([(p, c) for p in root.iter() for c in p])
    parent.remove(child)


def drop_attribute(root: ET.Element, rng: random.Random) -> None:
    """Remove an attribute of numbers."""
    element, key = rng.choice(numbers(root))
    del element.attrib[key]


def add_number(root: ET.Element, rng: random.Random) -> None:
    """Add a number to an attribute."""
    element, key = rng.choice(numbers(root))
    element.set(key, element.attrib[key] + " 1")


def rename(root: ET.Element, rng: random.Random) -> None:
    """Give a name that is empty, taken, or odd."""
    named = [element for element in root.iter() if element.get("name")]
    names = ["", "x y", "é", "<b>", "a/b", named[-1].get("name", "")]
    rng.choice(named).set("name", rng.choice(names))


def swap_inertias(root: ET.Element, rng: random.Random) -> None:
    """Swap the inertias of two links."""
    held = [*root.iter("inertia")] or [x for x in root.iter() if x.get("mass")]
    one, other = rng.sample(held, 2)
    one.attrib, other.attrib = dict(other.attrib), dict(one.attrib)


KINDS: dict[str, Spoil] = {
    "another sign": one_number(lambda x: -x),
    "zero": one_number(lambda x: 0),
    "a million times as large": one_number(lambda x: 1e6 * x),
    "not a number": one_number(lambda x: "nan"),
    "text": one_number(lambda x: "abc"),
    "one number too many": add_number,
    "lengths in mm": all_lengths((1e3,)),
    "0.2 to 3 times as large": all_lengths((0.2, 0.5, 2.0, 3.0)),
    "an element is missing": drop_element,
    "an attribute is missing": drop_attribute,
    "names": rename,
    "inertias swapped": swap_inertias,
}


def ended(*words: str) -> tuple[int | str, str]:
    """Return the exit code of a command, or the exception, and what it printed."""
    try:
        code, _, errors = told(*words)
    except Exception as error:
        return f"{type(error).__name__}: {error}", ""
    return code, errors


def outcome(file: Path) -> str:
    """Return what comes of a file."""
    code, text = ended("check", str(file), "--steps", STEPS)
    if code not in (0, 1, 2) or (code == 2 and len(text.strip().splitlines()) != 1):
        return f"broken: {code}"
    if code:
        return "refused" if code == 2 else "not able"
    with tempfile.TemporaryDirectory() as folder:
        code, _ = ended("walk", str(file), "--steps", STEPS, "--out", folder)
    return "walks" if code == 0 else "FALLS" if code == 1 else f"broken: {code}"


def main(count: int) -> None:
    """Spoil, try, and print a table by kind."""
    seen: Counter[tuple[str, str]] = Counter()
    for robot in ROBOTS:
        try:
            path = read_model(robot).path
        except ModelError as error:
            print(error)
            continue
        text = path.read_text(encoding="utf-8")
        with tempfile.TemporaryDirectory() as folder:
            spoilt = Path(folder, f"spoilt{path.suffix}")
            for k in range(count):
                kind = list(KINDS)[k % len(KINDS)]
                root, rng = ET.fromstring(text), random.Random(f"{robot} {k}")
                KINDS[kind](root, rng)
                spoilt.write_text(ET.tostring(root, encoding="unicode"), "utf-8")
                end = outcome(spoilt)
                seen[kind, end] += 1
                if end not in ("walks", "refused", "not able"):
                    print(robot, k, kind, end, flush=True)
    ends = sorted({end for _, end in seen})
    print("| kind |", " | ".join(ends), "|")
    print("|---|" + "---|" * len(ends))
    for kind in KINDS:
        print("|", kind, "|", " | ".join(str(seen[kind, end]) for end in ends), "|")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60)
