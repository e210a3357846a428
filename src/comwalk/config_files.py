"""Configurations from TOML tables and flags, and back into a command line."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import shlex
import tomllib
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Any,
    Literal,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from .config import (
    _UNSEEN,
    CertifyConfig,
    DanceConfig,
    Given,
    IdentifyConfig,
    PatternConfig,
    RobotConfig,
    WalkConfig,
)
from .errors import ComwalkError, ParameterError, nearest

if TYPE_CHECKING:
    pass


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


Table = Mapping[str, Any]
"""Values and tables of values by key."""


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
    written = {} if file is None else read_table(file)
    return _construct(kind, written, given or {}, str(file), "")


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
    try:
        text = path.read_text(encoding="utf-8")
        if path.suffix.lower() == ".json":
            document = json.loads(text)["settings"]["config"]
        else:
            document = tomllib.loads(text)
    except OSError as error:
        raise ParameterError(f"cannot read {path}: {error.strerror}") from None
    except (KeyError, TypeError):
        raise ParameterError(f"{path} is not the summary.json of a run") from None
    except (ValueError, RecursionError) as error:
        kind = "JSON" if path.suffix.lower() == ".json" else "TOML"
        raise ParameterError(f"{path} is not valid {kind}: {error}") from None
    return _underscored(document)


def _underscored(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    return {str(k).replace("-", "_"): _underscored(v) for k, v in value.items()}


def fields_of(kind: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that a user may give.

    Args:
        kind: The dataclass.

    Returns:
        Type hints by name.
    """
    hints = get_type_hints(kind)
    names = [f.name for f in dataclasses.fields(kind) if f.init]
    return {n: hints[n] for n in names if (kind, n) not in _UNSEEN}


def part_of(hint: Any) -> Any:
    """Return the part of which a field holds given values.

    Args:
        hint: Type of the field.

    Returns:
        The dataclass of the part; None if the field is no `Given`.
    """
    return get_args(hint)[0] if get_origin(hint) is Given else None


def _construct(kind: Any, written: Any, given: Table, file: str, prefix: str) -> Any:
    """Return a dataclass from the table of a file and from flags."""
    part = part_of(kind)
    hints = fields_of(part or kind)
    _check_keys(written, hints, file, prefix)
    values: dict[str, Any] = {}
    for name, hint in hints.items():
        if part_of(hint) or dataclasses.is_dataclass(hint):
            tables = written.get(name, {}), given.get(name, {})
            values[name] = _construct(hint, *tables, file, f"{prefix}{name}.")
        elif name in given:
            none = given[name] == "none" and _is_optional(hint)
            values[name] = None if none else given[name]
        elif name in written:
            where = f"{file}: {prefix}{name}"
            values[name] = _typed(written[name], hint, where)
    try:
        return kind(**values) if part is None else Given(part, values)
    except ComwalkError as error:
        text = _located(str(error), hints, set(written) - set(given), file, prefix)
        raise type(error)(text) from None


def _check_keys(table: Any, known: Mapping[str, Any], file: str, prefix: str) -> None:
    """Refuse what is not a table, and unknown keys."""
    if not isinstance(table, Mapping):
        key = prefix.rstrip(".")
        raise ParameterError(
            f"{file}: {key} must be a table, written [{key}], got {table!r}"
        )
    for key in table:
        if key not in known:
            raise ParameterError(
                f'{file}: unknown key "{prefix}{key}"; {nearest(key, known)}'
            )


def _located(
    text: str, names: Mapping[str, Any], written: set[str], file: str, prefix: str
) -> str:
    """Return a message that starts with the whole key, and with the file it is in."""
    found = re.match(r"(?:\w+\.)?(\w+)", text)
    name = found.group(1) if found else ""
    if name not in names:
        return text
    if not text.startswith(prefix):
        text = prefix + text
    return f"{file}: {text}" if name in written else text


def _is_optional(hint: Any) -> bool:
    return isinstance(hint, types.UnionType) and types.NoneType in get_args(hint)


def _typed(value: Any, hint: Any, where: str) -> Any:
    """Return a value of a file if it is of the type that a field has."""
    if _is_optional(hint):
        if value == "none":
            return None
        (hint,) = (h for h in get_args(hint) if h is not types.NoneType)
    if get_origin(hint) is tuple:
        return _typed_items(value, get_args(hint), where)
    if get_origin(hint) is Literal:
        known = get_args(hint)
        if value not in known:
            words = " or ".join(f'"{k}"' for k in known)
            hint_text = nearest(str(value), known)
            raise ParameterError(f"{where} must be {words}, got {value!r}; {hint_text}")
        return value
    accepted = (int, float) if hint is float else (hint,)
    if not isinstance(value, accepted) or (
        isinstance(value, bool) and hint is not bool
    ):
        raise ParameterError(f"{where} must be {_WORDS[hint]}, got {value!r}")
    if isinstance(value, str) and not value.isprintable():
        raise ParameterError(f"{where} must be printable text, got {value!r}")
    return value


_WORDS = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "text in quotes",
}


def _typed_items(value: Any, hints: Sequence[Any], where: str) -> Any:
    """Return an array of a file as a tuple; one number may stand for two."""
    many = hints[-1] is Ellipsis
    items = list(value) if isinstance(value, list) else [value]
    if not many and len(items) not in (1, len(hints)):
        raise ParameterError(
            f"{where} must be one number or {len(hints)}, got {len(items)}"
        )
    typed = tuple(_typed(item, hints[0], where) for item in items)
    return typed * len(hints) if len(typed) == 1 and not many else typed


def table_of(config: Any) -> dict[str, Any]:
    """Return a configuration as a table that `make_config` takes.

    Args:
        config: A configuration.

    Returns:
        All values that are not None, ready for TOML or JSON.

    Example:
        >>> table_of(PatternConfig(steps=3))["steps"]
        3
    """
    names = fields_of(type(config))
    values = {name: getattr(config, name) for name in names}
    return {
        name: _tabled(value)
        for name, value in values.items()
        if value is not None or getattr(type(config), name, None) is not None
    }


def _tabled(value: Any) -> Any:
    """Return a value as TOML and JSON can hold it; what is not finite means none."""
    if isinstance(value, Given):
        return {name: _tabled(v) for name, v in value.values.items()}
    if dataclasses.is_dataclass(value):
        return table_of(value)
    if isinstance(value, tuple):
        return list(value)
    infinite = isinstance(value, float) and not math.isfinite(value)
    return "none" if value is None or infinite else value


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
