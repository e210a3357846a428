"""Flags of the command line, made from the dataclasses of settings.

Each setting becomes a flag: its text is the help, its default is shown. A flag
that is not given is None, so that a file can give its value.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache, partial
from types import FunctionType, UnionType
from typing import Annotated, Any, get_args, get_origin

from cyclopts import Group, Parameter

from ..errors import ParameterError
from ..settings import Given, settings_of


@cache
def flags_of(
    kind: Any, skipped: tuple[str, ...] = (), *, suits_robot: bool = False
) -> Any:
    """Return a dataclass of flags that mirrors one of settings.

    Args:
        kind: The dataclass of settings; fields of a base class come last.
        skipped: Names of fields without a flag.
        suits_robot: Whether the robot has its own defaults, and those of the
            dataclass are the paper's.

    Returns:
        The dataclass, for a parser that flattens it.
    """
    rows: list[tuple[str, Any, Any]] = []
    declared = settings_of(kind)
    for name in sorted(declared, key=lambda name: name not in kind.__annotations__):
        if name in skipped:
            continue
        own = declared[name]
        hint, default = own.hint, own.default
        if dataclasses.is_dataclass(default):
            is_given = isinstance(default, Given)
            part = default.kind if is_given else type(default)
            flags = flags_of(part, suits_robot=is_given)
            group = Group.create_ordered(own.help)
            factory = dataclasses.field(default_factory=flags)
            rows.append((name, _noted(flags, Parameter(group=group)), factory))
        else:
            text = own.text + _shown(default, suits_robot)
            flag = _noted(_hint(hint), Parameter(help=text, **_parsing(hint, default)))
            rows.append((name, flag, dataclasses.field(default=None)))
    mirror = dataclasses.make_dataclass(f"{kind.__name__}Flags", rows, kw_only=True)
    mirror.__module__ = __name__
    return mirror


def _noted(hint: Any, note: Parameter) -> Any:
    return Annotated[hint, note]


def _shown(default: Any, suits_robot: bool) -> str:
    """Return a default value for a help text."""
    if default is None or default is False or default == ():
        return ""
    items = default if isinstance(default, tuple) else (default,)
    words = [f"{x:g}" if isinstance(x, float) else str(x) for x in items]
    value = "yes" if default is True else ", ".join(words)
    return (
        f" (default: the robot's; paper {value})"
        if suits_robot
        else (f" (default {value})")
    )


def _hint(hint: Any) -> Any:
    if get_origin(hint) is tuple and get_args(hint)[-1] is Ellipsis:
        return list[str] | None
    return Any if _count(hint) else hint | None


def _count(hint: Any) -> int:
    """Return how many numbers a tuple has; 0 for all else."""
    options = get_args(hint) if isinstance(hint, UnionType) else (hint,)
    return max(len(a) if {*(a := get_args(x))} == {float} else 0 for x in options)


def _parsing(hint: Any, default: Any) -> dict[str, Any]:
    """Return how the words of a flag are read."""
    if count := _count(hint):
        metavar = f"X[,{','.join('YZ'[: count - 1])}]"
        reading = {
            "converter": partial(_read_several, count),
            "n_tokens": 1,
            "metavar": metavar,
        }
        return {**reading, "negative": ()}
    if hint is int:
        return {"converter": _read_whole, "negative": ()}
    if isinstance(hint, UnionType):
        read = _read_number if {float, int} & {*get_args(hint)} else _read_text
        return {"converter": read, "negative": ()}
    return {} if hint is bool and default else {"negative": ()}


def _read_text(hint: Any, tokens: Any) -> str:
    return tokens[0].value


def _read_number(hint: Any, tokens: Any) -> float | str:
    """Return a number, or the word "none"."""
    text = tokens[0].value
    try:
        return text.lower() if text.lower() == "none" else float(text)
    except ValueError:
        raise ParameterError(f'not a number, nor "none": "{text}"') from None


def _read_whole(hint: Any, tokens: Any) -> int:
    try:
        return int(tokens[0].value)
    except ValueError:
        raise ParameterError(f'not a whole number: "{tokens[0].value}"') from None


def _read_several(count: int, hint: Any, tokens: Any) -> tuple[float, ...] | str:
    """Return the numbers of "3" or "3,1.8", or the word "none"."""
    if tokens[0].value == "none":
        return "none"
    try:
        numbers = tuple(float(word) for word in tokens[0].value.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in (1, count):
        words, such = ("two", "3,1.8") if count == 2 else ("three", "100,40,2")
        raise ParameterError(
            f'not one number or {words}, such as 3 or {such}: "{tokens[0].value}"'
        )
    return numbers * count if len(numbers) == 1 else numbers


def given_flags(flags: Any) -> dict[str, Any]:
    """Return the flags that were given.

    Args:
        flags: A dataclass of `flags_of`, filled by the parser.

    Returns:
        Values by name, with tables for groups; what `make_config` takes.
    """
    given: dict[str, Any] = {}
    for name, value in vars(flags).items():
        if dataclasses.is_dataclass(value):
            value = given_flags(value) or None
        if value is not None:
            given[name] = tuple(value) if isinstance(value, list) else value
    return given


def with_flags(kind: Any) -> Callable[[FunctionType], FunctionType]:
    """Give a command's parameter `flags` its type, which is made at run time.

    Args:
        kind: The dataclass of `flags_of`.

    Returns:
        The decorator.
    """

    def decorate(function: FunctionType) -> FunctionType:
        function.__annotations__["flags"] = _noted(kind, Parameter(name="*"))
        function.__kwdefaults__ = {**(function.__kwdefaults__ or {}), "flags": kind()}
        return function

    return decorate


HostFlag = Annotated[
    str, Parameter(help="Address to serve a page at; 0.0.0.0 for other machines too.")
]
"""`--host`."""

PortFlag = Annotated[int, Parameter(help="Port of a page; 0 for any that is free.")]
"""`--port`."""

OpenFlag = Annotated[
    bool, Parameter(help="Open a page in this machine's browser.", negative=())
]
"""`--open`."""
