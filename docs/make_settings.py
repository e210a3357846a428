"""Write docs/settings.md: every setting with its key, unit, range and default."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from comwalk.config import CertifyConfig, DanceConfig, IdentifyConfig, WalkConfig
from comwalk.robot import Profile
from comwalk.settings import Given, Setting, settings_of

PAGE = Path(__file__).parent / "settings.md"
HEAD = """\
# Settings

Each row is a key of a TOML file (`--config FILE`) and a flag: `half_step`
under `[gait]` is `--gait.half-step`. Defaults are the paper's; `comwalk robot NAME` has
those of a robot. Written by `python docs/make_settings.py` from the declarations.
"""
COMMANDS = {
    "walk": WalkConfig,
    "dance": DanceConfig,
    "certify": CertifyConfig,
    "identify": IdentifyConfig,
}


def page() -> str:
    """Return the text of the page; a table that several commands share comes once."""
    parts: dict[tuple[str, Any], list[str]] = {}
    lines = [HEAD]
    for command, kind in COMMANDS.items():
        declared = settings_of(kind)
        plain = {k: s for k, s in declared.items() if part_of(s) is None}
        lines += [f"## `comwalk {command}`", "", *table(plain), ""]
        for name, own in declared.items():
            part = part_of(own)
            if part is not None:
                parts.setdefault((name, part), []).append(command)
    for (name, part), commands in parts.items():
        users = ", ".join(commands)
        lines += [f"## `[{name}]` of {users}", "", *table(settings_of(part)), ""]
    lines += ["## A profile: `--profile FILE`", "", *table(settings_of(Profile)), ""]
    return "\n".join(lines)


def part_of(declared: Setting) -> Any:
    """Return the dataclass of a setting that is a table, None for others."""
    default = declared.default
    if isinstance(default, Given):
        return default.kind
    return type(default) if dataclasses.is_dataclass(default) else None


def table(declared: dict[str, Setting]) -> Iterator[str]:
    """Yield the rows of a table in Markdown."""
    yield "| key | default | unit | range | meaning |"
    yield "|---|---|---|---|---|"
    for name, own in declared.items():
        cells = (f"`{name}`", shown(own.default), own.unit, own.within, own.help)
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def shown(default: Any) -> str:
    """Return a default value as TOML users write it."""
    if default in (None, (), {}) or dataclasses.is_dataclass(default):
        return ""
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, tuple):
        return "[" + ", ".join(f"{x:g}" for x in default) + "]"
    return f"{default:g}" if isinstance(default, (int, float)) else f'"{default}"'


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
