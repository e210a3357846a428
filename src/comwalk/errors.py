"""The errors of comwalk: each takes data and says what to change.

Every error is a `ComwalkError` and also the builtin that a caller would expect:

* ComwalkError
    * ParameterError (ValueError): a number outside its range
    * PlanError (ValueError): a footstep plan that cannot be walked
    * MotionError (ValueError): an embedded motion that cannot be played
    * ModelError (LookupError): a robot model that is missing, broken or incomplete
    * RunError (ValueError): a run folder that cannot be written or read
    * ViewError (OSError): a page that cannot be served or shown

A fall is not an error: it is an outcome (`comwalk.Outcome`).
"""

from __future__ import annotations

import difflib
import math
import numbers
import os
import re
from collections.abc import Iterable


class ComwalkError(Exception):
    """Base of all errors that comwalk raises on purpose."""


class ParameterError(ComwalkError, ValueError):
    """A parameter is not a finite number in its range."""


class PlanError(ComwalkError, ValueError):
    """A footstep plan cannot be walked."""


class MotionError(ComwalkError, ValueError):
    """An embedded motion cannot be played by the robot."""


class ModelError(ComwalkError, LookupError):
    """A robot model is missing, broken or lacks something that walking needs."""


class RunError(ComwalkError, ValueError):
    """A run folder cannot be written, or is not one that comwalk wrote."""


class ViewError(ComwalkError, OSError):
    """A page cannot be served: its port is in use, or a package is missing."""


def checked_number(
    name: str,
    value: object,
    *,
    unit: str = "",
    low: float = -math.inf,
    high: float = math.inf,
    open_low: bool = False,
    open_high: bool = False,
    hint: str = "",
) -> float:
    """Return `value` as a float inside its range, or say what to change.

    Args:
        name: What the number is called where the user wrote it.
        value: The number; an int, a float or a numpy scalar.
        unit: Unit for the message, such as "m".
        low: Smallest value allowed.
        high: Largest value allowed.
        open_low: Whether `low` itself is excluded.
        open_high: Whether `high` itself is excluded.
        hint: What to change, added to the message.

    Returns:
        The value as a float.

    Raises:
        ParameterError: If it is not a number, not finite, or out of range.
    """
    is_number = isinstance(value, numbers.Real) and not isinstance(value, bool)
    x = float(value) if is_number else math.nan  # type: ignore[arg-type]
    inside = (low < x if open_low else low <= x) and (
        x < high if open_high else x <= high
    )
    if not (math.isfinite(x) and inside):
        left, right = "(["[not open_low], ")]"[not open_high]
        if math.isinf(low):
            left = "("
        if math.isinf(high):
            right = ")"
        span = f"{left}{low:.6g}, {high:.6g}{right}"
        got = f"{x:.6g}" if is_number else repr(value)
        suffix = f"; {hint}" if hint else ""
        unit_text = f" {unit}" if unit else ""
        raise ParameterError(
            f"{name} must be a number in {span}{unit_text}, got {got}{suffix}"
        )
    return x


def checked_count(name: str, value: object, low: int, high: int) -> int:
    """Return a whole number inside its range.

    Args:
        name: What the number is called where the user wrote it.
        value: The number, an int or a numpy integer.
        low: Smallest value allowed.
        high: Largest value allowed.

    Returns:
        The number as an int.

    Raises:
        ParameterError: If it is not a whole number in [low, high].
    """
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not whole or not low <= int(value) <= high:  # type: ignore[call-overload]
        raise ParameterError(
            f"{name} must be a whole number in [{low}, {high}], got {value!r}"
        )
    return int(value)  # type: ignore[call-overload]


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a phrase that names the known word nearest to a mistyped one.

    Args:
        name: The word that was not found.
        known: The words that exist.

    Returns:
        `did you mean "x"?`, or the list of all words if none is near.
    """
    words = sorted(known)
    close = difflib.get_close_matches(name, words, n=1, cutoff=0.6)
    if close:
        return f'did you mean "{close[0]}"?'
    return "known: " + (", ".join(words) if words else "none")


def one_line(error: Exception) -> str:
    """Return the text of another library's error on one line.

    Args:
        error: The error.

    Returns:
        Its text without line breaks, or the name of its kind if it has none.
    """
    return " ".join(str(error).split()) or type(error).__name__


def utf8(name: str) -> str:
    """Return a file's name as text that can be written anywhere.

    Args:
        name: As the system gives it; bytes that are not UTF-8 become U+FFFD.
    """
    return os.fsencode(name).decode("utf-8", "replace")


def printable(text: str) -> str:
    r"""Return text without what would steer a terminal, such as escape sequences.

    Args:
        text: It may hold names from files.

    Returns:
        The text, control characters but tabs and line breaks written as in `\x1b`.
    """
    return _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
