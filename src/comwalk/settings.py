"""Settings: what a user may change, declared once.

A field of a frozen dataclass states its default, meaning, unit and range. From these
come the check of its value, the text of its error, its flag with help, its key in
files and its row in the documentation.
"""

from __future__ import annotations

import dataclasses
import math
import re
import tomllib
import types
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field
from enum import Enum
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from .errors import (
    ComwalkError,
    ParameterError,
    checked_count,
    checked_number,
    nearest,
)
from .sides import Side

Kind = TypeVar("Kind")
"""A dataclass of settings."""

Table = Mapping[str, Any]
"""Values and tables of values by key, as in a TOML file."""


@dataclass(frozen=True)
class Range:
    """The numbers that a setting allows."""

    low: float = -math.inf
    """Smallest."""
    high: float = math.inf
    """Largest."""
    open_low: bool = True
    """Whether `low` itself is excluded."""
    open_high: bool = True
    """Whether `high` itself is excluded; a closed inf allows inf."""

    @classmethod
    def parse(cls, text: str) -> Range:
        """Return a range from its text, such as "(0, 10]"; "" for all numbers."""
        if not text:
            return cls()
        low, high = (float(word) for word in text[1:-1].split(","))
        return cls(low, high, text[0] == "(", text[-1] == ")")


@dataclass(frozen=True)
class Setting:
    """The declaration of one field."""

    help: str
    """Its meaning, for users."""
    unit: str
    """Unit, such as "m"; "" for numbers without one and for words."""
    within: str
    """The range as users read it; "" if there is none."""
    items: tuple[str, ...]
    """Names of the numbers of a pair, such as ("length", "width")."""
    hint: Any = None
    """Type of the field."""
    default: Any = ...
    """Its default; `...` if it must be given."""

    @cached_property
    def range(self) -> Range:
        """The range as numbers."""
        return Range.parse(self.within)

    @cached_property
    def is_optional(self) -> bool:
        """Whether None is a value."""
        is_union = isinstance(self.hint, types.UnionType)
        return is_union and types.NoneType in get_args(self.hint)

    @cached_property
    def bare(self) -> Any:
        """The type without None."""
        options = [h for h in get_args(self.hint) if h is not types.NoneType]
        return options[0] if self.is_optional else self.hint

    @property
    def text(self) -> str:
        """Meaning, unit and range as one sentence, for a flag's help or a table."""
        head, mark, tail = self.help.partition(";")
        unit = f" [{self.unit}]" if self.unit else ""
        within = f", in {self.within}" if self.within else ""
        return f"{head}{unit}{within}{mark}{tail}."

    def checked(self, name: str, value: Any) -> Any:
        """Return a value as the field stores it.

        Args:
            name: What it is called where the user wrote it.
            value: The value, or what a file says instead: a list, a table, "none".

        Returns:
            Numbers as float or int, lists as tuples, tables as dataclasses.

        Raises:
            ParameterError: If it is of another kind or out of range.
        """
        if self.is_optional and (value is None or _is_word(value, "none")):
            return None
        return _checked(self, self.bare, name, value)


def setting(
    default: Any,
    help: str,
    unit: str = "",
    within: str = "",
    *,
    items: tuple[str, ...] = (),
) -> Any:
    """Declare a setting: a field of a frozen dataclass that a user may change.

    Args:
        default: Its default; `...` if it must be given.
        help: Its meaning, without a full stop. Unit and range are added before the
            first semicolon.
        unit: Unit of the number, or of each of several.
        within: Range of the number, such as "(0, 10]"; "inf]" allows inf.
        items: Names of several numbers, for errors.

    Returns:
        The field.
    """
    about = {"setting": Setting(help, unit, within, items)}
    if default is ...:
        return field(metadata=about)
    if isinstance(default, dict):
        return field(default_factory=lambda: dict(default), metadata=about)
    return field(default=default, metadata=about)


@cache
def settings_of(kind: type) -> Mapping[str, Setting]:
    """Return the declared settings of a dataclass.

    Args:
        kind: The dataclass.

    Returns:
        Settings by the name of their field; other fields are left out.

    Example:
        >>> from comwalk.pattern import Gait
        >>> settings_of(Gait)["turn"].text
        'Turn of the body per step, left positive [rad], in [-0.8, 0.8].'
    """
    hints = get_type_hints(kind)
    dataclass_kind: Any = kind
    return {
        f.name: dataclasses.replace(
            f.metadata["setting"], hint=hints[f.name], default=_default_of(f)
        )
        for f in dataclasses.fields(dataclass_kind)
        if "setting" in f.metadata
    }


def same_setting(kind: type, name: str) -> Any:
    """Declare a setting that another dataclass has too, the same in all respects.

    Args:
        kind: The other dataclass.
        name: Its field.

    Returns:
        The field.
    """
    other = settings_of(kind)[name]
    return field(default=other.default, metadata={"setting": other})


def _default_of(declared: dataclasses.Field[Any]) -> Any:
    if declared.default_factory is not MISSING:
        return declared.default_factory()
    return ... if declared.default is MISSING else declared.default


def check_settings(owner: Any) -> None:
    """Check all settings of a frozen dataclass, in its `__post_init__`.

    Args:
        owner: The dataclass; values are stored as `Setting.checked` returns them.

    Raises:
        ParameterError: If one is of another kind or out of range.
    """
    for name, declared in settings_of(type(owner)).items():
        value = getattr(owner, name)
        checked = declared.checked(name, value)
        if checked is not value:
            object.__setattr__(owner, name, checked)


# ---- Values -----------------------------------------------------------------------


def _is_word(value: object, word: str) -> bool:
    return isinstance(value, str) and value == word


def _checked(declared: Setting, hint: Any, name: str, value: Any) -> Any:
    """Return a value of a type other than None."""
    if hint is float:
        return _number(declared, name, value)
    if hint is int:
        span = declared.range
        return checked_count(name, value, int(span.low), int(span.high))
    if hint is bool or hint is str:
        return _plain(hint, name, value)
    origin = get_origin(hint)
    if origin is Literal or (isinstance(hint, type) and issubclass(hint, Enum)):
        return _choice(hint, name, value)
    if origin is tuple:
        return _several(declared, get_args(hint), name, value)
    if origin is Mapping:
        return _mapping(declared, *get_args(hint), name, value)
    return decode(hint, value, name)


def _number(declared: Setting, name: str, value: Any) -> float:
    span = declared.range
    if value == span.high == math.inf and not span.open_high:
        return value
    return checked_number(
        name,
        value,
        unit=declared.unit,
        low=span.low,
        high=span.high,
        open_low=span.open_low,
        open_high=span.open_high,
    )


def _plain(hint: type, name: str, value: Any) -> Any:
    """Return a text, or true or false."""
    if not isinstance(value, hint) or value == "":
        what = "true or false" if hint is bool else "text in quotes"
        raise ParameterError(f"{name} must be {what}, got {value!r}")
    if hint is str and any(unicodedata.category(c) == "Cc" for c in value):
        raise ParameterError(f"{name} must be printable text, got {value!r}")
    return value


def _choice(hint: Any, name: str, value: Any) -> Any:
    """Return one of several words."""
    is_enum = isinstance(hint, type)
    known = [word.value for word in hint] if is_enum else get_args(hint)
    if not isinstance(value, str) or value not in known:
        words = " or ".join(f'"{word}"' for word in known)
        hint_text = nearest(str(value), known)
        raise ParameterError(f"{name} must be {words}, got {value!r}; {hint_text}")
    return hint(value) if is_enum else value


def _several(
    declared: Setting, hints: tuple[Any, ...], name: str, value: Any
) -> tuple[Any, ...]:
    """Return a tuple; one value may stand for all, or be the only one."""
    is_list = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    given, many = list(value) if is_list else [value], hints[-1] is Ellipsis
    if not many and len(given) not in (1, len(hints)):
        names = f" ({', '.join(declared.items)})" if declared.items else ""
        unit = f" in {declared.unit}" if declared.unit else ""
        raise ParameterError(
            f"{name} must be one number or {len(hints)}{names}{unit}, got {len(given)}"
        )
    labels = [f"{name} ({item})" for item in declared.items] or [name] * len(given)
    checked = [
        _checked(declared, hints[0], label, item)
        for label, item in zip(labels, given, strict=False)
    ]
    return tuple(checked * (1 if many else len(hints) // len(checked)))


def _mapping(declared: Setting, keys: Any, hint: Any, name: str, value: Any) -> Any:
    """Return a table of values; for sides, "both" stands for left and right."""
    table, found = _table(name, value), {}
    for word, part in table.items():
        sides = (word,)
        if keys is Side:
            sides = tuple(Side) if word == "both" else (word,)
            if word not in (*Side, "both"):
                known = nearest(word, (*Side, "both"))
                raise ParameterError(f'unknown key "{name}.{word}"; {known}')
        own = _checked(declared, hint, f"{name}.{word}", part)
        found |= {keys(key): own for key in sides}
    return found


# ---- Tables -----------------------------------------------------------------------


def _table(name: str, value: Any) -> Table:
    if not isinstance(value, Mapping):
        raise ParameterError(
            f"{name} must be a table, written [{name}], got {value!r}"
            if name
            else f"must be a table, got {value!r}"
        )
    return value


def check_keys(table: Table, known: Sequence[str], prefix: str = "") -> None:
    """Refuse keys that are not known.

    Args:
        table: The table.
        known: Keys that it may have.
        prefix: What to put before a key in the message.

    Raises:
        ParameterError: If a key is unknown; it names the nearest.
    """
    for key in table:
        if key not in known:
            raise ParameterError(f'unknown key "{prefix}{key}"; {nearest(key, known)}')


def decode(kind: type[Kind], table: Any, name: str = "") -> Kind:
    """Return a dataclass of settings from a table.

    Args:
        kind: The dataclass, or `Given` of one.
        table: Values by the name of their field; a `kind` is returned as it is.
        name: The table's own name, such as "gait"; "" for a whole file.

    Returns:
        The dataclass; fields that the table leaves out have their defaults.

    Raises:
        ParameterError: If a key is unknown, or a value is of another kind or out of
            range; the message begins with the whole key.
    """
    part = get_args(kind)[0] if get_origin(kind) is Given else None
    if isinstance(table, Given if part else kind):
        return table
    known, prefix = settings_of(part or kind), f"{name}." if name else ""
    check_keys(_table(name, table), tuple(known), prefix)
    values = {k: known[k].checked(f"{prefix}{k}", v) for k, v in table.items()}
    make: Any = kind if part is None else Given
    try:
        return make(**values) if part is None else make(part, values)
    except ComwalkError as error:
        raise type(error)(_prefixed(str(error), known, prefix)) from None


def _prefixed(text: str, known: Table, prefix: str) -> str:
    """Return a message that begins with the whole key of the field it is about."""
    found = re.match(r"\w+", text)
    return prefix + text if found and found[0] in known else text


@dataclass(frozen=True)
class Given(Generic[Kind]):
    """The settings that a user gave; others suit the robot."""

    kind: type[Kind]
    """The dataclass whose settings they are."""
    values: Table = field(default_factory=dict)
    """Values by the name of their field."""

    def __post_init__(self) -> None:
        """Check the values; store them as the dataclass does.

        Raises:
            ParameterError: If a value is out of range.
        """
        known = settings_of(self.kind)
        check_keys(self.values, tuple(known))
        values = {k: known[k].checked(k, v) for k, v in self.values.items()}
        object.__setattr__(self, "values", values)

    def over(self, defaults: Kind) -> Kind:
        """Return the defaults with the given values in their place.

        Args:
            defaults: The dataclass as it suits the robot.

        Returns:
            The whole dataclass.
        """
        whole: Any = defaults
        return dataclasses.replace(whole, **self.values)


def table_of(owner: Any) -> dict[str, Any]:
    """Return a dataclass of settings as a table that `decode` takes.

    Args:
        owner: The dataclass.

    Returns:
        All values but those that are None by default, ready for TOML or JSON.

    Example:
        >>> from comwalk.pattern import Pendulum
        >>> table_of(Pendulum())
        {'height': 0.687, 'gravity': 9.81, 'inertia': 0.0}
    """
    if isinstance(owner, Given):
        return {name: _tabled(value) for name, value in owner.values.items()}
    rows = [(k, getattr(owner, k), s) for k, s in settings_of(type(owner)).items()]
    return {
        name: _tabled(value)
        for name, value, declared in rows
        if value is not None or declared.default is not None
    }


def _tabled(value: Any) -> Any:
    """Return a value as TOML and JSON can hold it; what is not finite means none."""
    if dataclasses.is_dataclass(value):
        return table_of(value)
    if isinstance(value, Mapping):
        return {str(key): _tabled(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return list(value)
    infinite = isinstance(value, float) and not math.isfinite(value)
    return "none" if value is None or infinite else value


def read_toml(path: str | Path) -> dict[str, Any]:
    """Return the table in a TOML file.

    Args:
        path: The file.

    Returns:
        Its keys and values.

    Raises:
        ParameterError: If it cannot be read, or is no TOML; the message begins with
            the path.
    """
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        why = error.strerror or str(error)
        raise ParameterError(f"{path}: cannot be read: {why}") from None
    except UnicodeDecodeError:
        raise ParameterError(f"{path}: not a text file in UTF-8") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ParameterError(f"{path}: not valid TOML: {error}") from None
