"""The XML of an MJCF as one tree: includes in place, what other files hold left out."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from ...errors import ModelError, one_line
from .parts import check_depth, first_of

_NAMES = {"name", "class", "childclass", "file", "mesh", "material", "joint", "body"}
_BAD_NUMBER = re.compile(r"(^|\s)[+-]?(nan|inf|infinity)(?=\s|$)", re.I)
_NAMED = ("geom", "site", "camera", "joint")
_REFERENCES = {
    "pair": {"geom1": "geom", "geom2": "geom"},
    "exclude": {"body1": "body", "body2": "body"},
}
_TYPES = {"xbody": "body", "freejoint": "joint"}


def whole_tree(root: ET.Element, folder: Path) -> tuple[ET.Element, list[str]]:
    """Return an MJCF with its includes in place, and without what names other files.

    A robot's file may be a part of a scene: contacts and sensors then name things of
    the scene, such as its floor.

    Args:
        root: The element `mujoco`.
        folder: The folder of the file.

    Returns:
        The tree, and notes on what was left out.

    Raises:
        ModelError: If an included file is missing or broken, or a number not finite.
    """
    _include(root, folder, folder, set())
    _check_models(root, folder, ())
    _check_numbers(root)
    return root, list(_drop_strangers(root))


def _include(parent: ET.Element, folder: Path, here: Path, read: set[Path]) -> None:
    """Put the content of included files where they are included.

    As in MuJoCo, a file is looked for beside the main one first, then beside the one
    that includes it.
    """
    for k in reversed(range(len(parent))):
        element = parent[k]
        if element.tag != "include":
            _include(element, folder, here, read)
            continue
        name = element.get("file", "")
        file = next((d / name for d in (folder, here) if (d / name).is_file()), None)
        file = folder / name if file is None else file
        if file.resolve() in read:
            raise ModelError(
                f"included file {file} is included twice, or includes itself; cut the "
                "loop"
            )
        read.add(file.resolve())
        included = _parsed(file, "included file")
        _include(included, folder, file.parent, read)
        parent[k : k + 1] = list(included)


def _parsed(file: Path, what: str) -> ET.Element:
    """Return the root of another file."""
    try:
        root = ET.parse(file).getroot()
        check_depth(root)
    except (OSError, ET.ParseError, ValueError, LookupError) as error:
        raise ModelError(f"{what} {file}: {one_line(error)}") from None
    return root


def _check_models(root: ET.Element, folder: Path, above: tuple[Path, ...]) -> None:
    """Check that no model that is attached attaches itself: MuJoCo would crash."""
    for element in root.iter("model"):
        file = (folder / element.get("file", "")).resolve()
        if file in above:
            raise ModelError(f"attached model {file} attaches itself; cut the loop")
        if file.is_file() and file.suffix == ".xml":
            model = _parsed(file, "attached model")
            _include(model, file.parent, file.parent, {file})
            _check_models(model, file.parent, (*above, file))


def _check_numbers(root: ET.Element) -> None:
    """Check that all numbers are finite."""
    for element in root.iter():
        for key, text in element.attrib.items():
            if key not in _NAMES and _BAD_NUMBER.search(text):
                raise ModelError(
                    f'<{element.tag} {key}="{text[:60]}"> must hold finite numbers'
                )


def _drop_strangers(root: ET.Element) -> Iterator[str]:
    """Remove contacts and sensors that name what the file does not have."""
    if any(root.iter("replicate")) or any(root.iter("attach")):  # make names
        return
    known: dict[str, set[str]] = {}
    for element in root.iter():
        kind = _TYPES.get(element.tag, element.tag)
        known.setdefault(kind, set()).add(element.get("name", ""))
    known.setdefault("body", set()).add("world")
    for group in (*root.findall("contact"), *root.findall("sensor")):
        strangers = []
        for element in list(group):
            absent = [
                name
                for kind, name in _named_by(element)
                if name not in known.get(kind, ())
            ]
            if absent:
                group.remove(element)
                strangers += absent
        if strangers:
            names = first_of(sorted(set(strangers)))
            yield f"<{group.tag}> names what another file holds, dropped: {names}"


def _named_by(element: ET.Element) -> Iterator[tuple[str, str]]:
    """Yield the kinds and names of what a contact or a sensor is about."""
    for key, kind in _REFERENCES.get(element.tag, {}).items():
        if key in element.attrib:
            yield kind, element.attrib[key]
    if element.tag in _REFERENCES:
        return
    for kind in _NAMED:
        if kind in element.attrib:
            yield kind, element.attrib[kind]
    for prefix in ("obj", "ref"):
        kind = element.get(f"{prefix}type", "")
        if f"{prefix}name" in element.attrib and kind:
            yield _TYPES.get(kind, kind), element.attrib[f"{prefix}name"]
