"""MuJoCo's OpenGL back end without a window: EGL, else OSMesa.

MuJoCo reads MUJOCO_GL when it is first imported, and a value whose library is missing
makes that import fail. So this module imports nothing heavy, and a program calls
`choose_backend` first.
"""

from __future__ import annotations

import ctypes
import os
import sys
from importlib import import_module
from typing import Any

from ..errors import ComwalkError, one_line

_LIBRARIES = {
    "egl": ("libEGL.so.1", "libEGL.so"),
    "osmesa": ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"),
}
_OFF = ("disable", "disabled", "off", "false", "0")


class RenderError(ComwalkError, RuntimeError):
    """Nothing can be drawn here; all else still works."""


def choose_backend() -> str:
    """Choose MuJoCo's OpenGL back end by MUJOCO_GL, before it is imported.

    What the user set is kept if it can work. Otherwise EGL is chosen if its library
    loads, else OSMesa, else what MuJoCo does by itself, which needs a display. Only
    Linux needs a choice.

    Returns:
        The value of MUJOCO_GL; empty if MuJoCo is left to itself.
    """
    wish = os.environ.get("MUJOCO_GL", "").lower().strip()
    if not sys.platform.startswith("linux"):
        return wish
    if wish in ("glfw", *_OFF) or (wish in _LIBRARIES and _loads(wish)):
        return wish
    chosen = next((name for name in _LIBRARIES if _loads(name)), "")
    os.environ["MUJOCO_GL"] = chosen
    return chosen


def open_context(width: int, height: int) -> Any:
    """Return a new OpenGL context without a window; free it after use.

    Args:
        width: Width [pixel].
        height: Height [pixel].

    Returns:
        A `GLContext` of MuJoCo: `make_current()`, `free()`.
    """
    name = choose_backend()
    if name in _OFF:
        raise RenderError(f"MUJOCO_GL={name} turns drawing off")
    module = f"mujoco.{name}" if name in _LIBRARIES else "mujoco"
    return import_module(module).GLContext(width, height)


def no_opengl(error: Exception) -> RenderError:
    """Return the error for a machine that cannot draw, with what to do.

    Args:
        error: What the attempt raised.

    Returns:
        The error, one line.
    """
    cause = one_line(error)
    return RenderError(
        f"no OpenGL: {cause[:160]}; install libegl1 and libgl1-mesa-dri, or libosmesa6 "
        "(names of Debian); everything else still works"
    )


def _loads(name: str) -> bool:
    """Return whether the library of a backend loads."""
    for library in _LIBRARIES[name]:
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        return True
    return False
