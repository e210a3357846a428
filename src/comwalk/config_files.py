"""Configurations from TOML tables and flags, and back into a command line."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from .config import (
    CertifyConfig,
    DanceConfig,
    IdentifyConfig,
    PatternConfig,
    RobotConfig,
    WalkConfig,
)
from .errors import ComwalkError, ParameterError
from .settings import Table, decode, read_toml

Config = TypeVar(
    "Config",
    RobotConfig,
    WalkConfig,
    DanceConfig,
    PatternConfig,
    CertifyConfig,
    IdentifyConfig,
)
"""One of the configurations."""


def make_config(
    kind: type[Config], given: Table | None = None, file: str | Path | None = None
) -> Config:
    """Return a configuration from flags and a file.

    Args:
        kind: Which configuration.
        given: Values by field name, with tables for fields that are dataclasses. They
            win over those of the file.
        file: TOML file with the same keys, or summary.json of an earlier run.

    Returns:
        The configuration; fields that neither gives have their defaults.

    Raises:
        ParameterError: If the file cannot be read, a key is unknown, or a value is of
            the wrong type or out of range; the message names file and key.

    Example:
        >>> make_config(WalkConfig, {"gait": {"half_step": 0.05}}).gait.values
        {'half_step': 0.05}
    """
    written, given = {} if file is None else read_table(file), given or {}
    try:
        return decode(kind, _merged(written, given))
    except ComwalkError as error:
        found = re.match(r'(?:unknown key ")?([\w.]+)', str(error))
        path = found[1].split(".") if found else []
        blamed = _says(written, path) and not _says(given, path)
        raise type(error)(f"{file}: {error}" if blamed else str(error)) from None


def _merged(written: Any, given: Table) -> Any:
    """Return the table of a file with what flags say in its place."""
    if not isinstance(written, Mapping):
        return written
    parts = {
        name: _merged(written.get(name, {}), value)
        if isinstance(value, Mapping)
        else value
        for name, value in given.items()
    }
    return {**written, **parts}


def _says(table: Any, path: Sequence[str]) -> bool:
    """Return whether a table has a key; a part of the key may be its last table."""
    for word in path:
        if not isinstance(table, Mapping):
            return True
        if word not in table:
            return False
        table = table[word]
    return bool(path)


def read_table(file: str | Path) -> dict[str, Any]:
    """Return the table in a file.

    Args:
        file: TOML file, or summary.json of an earlier run.

    Returns:
        Its keys, hyphens made underscores, and values.

    Raises:
        ParameterError: If the file is missing or broken.
    """
    path = Path(file)
    if path.suffix.lower() != ".json":
        return _underscored(read_toml(path))
    try:
        document = json.loads(path.read_text(encoding="utf-8"))["settings"]["config"]
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read: {error.strerror}") from None
    except (KeyError, TypeError):
        raise ParameterError(f"{path} is not the summary.json of a run") from None
    except (ValueError, RecursionError) as error:
        raise ParameterError(f"{path}: not valid JSON: {error}") from None
    return _underscored(document)


def _underscored(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    return {str(k).replace("-", "_"): _underscored(v) for k, v in value.items()}


def command_line(command: str, given: Table, file: str | Path | None = None) -> str:
    """Return the command line that gives the same configuration.

    Args:
        command: Its first word, such as "walk".
        given: Values of the flags.
        file: The file of `--config`, if any.

    Returns:
        Words quoted for a shell.

    Example:
        >>> given = {"robot": "paper", "steps": 4, "gains": {"zmp": (3.0, 1.8)}}
        >>> command_line("walk", given)
        'comwalk walk paper --steps 4 --gains.zmp 3.0,1.8'
    """
    flags = dict(given)
    words = ["comwalk", command, *filter(None, [flags.pop("robot", None)])]
    if file is not None:
        words += ["--config", str(file)]
    return shlex.join([*words, *_flags(flags, "")])


def _flags(table: Table, prefix: str) -> list[str]:
    """Return flags and their values."""
    words: list[str] = []
    for name, value in table.items():
        flag = f"--{prefix}{name.replace('_', '-')}"
        if isinstance(value, Mapping):
            words += _flags(value, f"{prefix}{name}.")
        elif isinstance(value, bool):
            dotted, _, last = flag.removeprefix("--").rpartition(".")
            words.append(flag if value else f"--{dotted}{dotted and '.'}no-{last}")
        elif isinstance(value, tuple) and value and isinstance(value[0], str):
            words += [word for item in value for word in (flag, item)]
        elif isinstance(value, tuple):
            words += [flag, ",".join(str(x) for x in value)]
        else:
            words += [flag, str(value)]
    return words
