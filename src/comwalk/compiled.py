"""One way to compile the inner loops: numba, where it is installed.

A kernel is a plain function of numbers and arrays. It is compiled when it is first
called, kept on disk for the next process, and runs uncompiled without numba: slower,
with the same result.

Importing numba takes longer than a short command does, so a module of kernels is
imported where it is used, never at the top of another module.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, TypeVar, cast

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])

try:
    import numba
    from numba.core import event
except ImportError:
    numba = None
else:

    class _Announcer(event.Listener):
        """Says once that compiling takes a while; loading from disk it keeps quiet."""

        said = False

        def on_start(self, event: Any) -> None:
            """Say it, if it is one of our kernels that is compiled."""
            module = event.data["dispatcher"].py_func.__module__
            if not self.said and module.startswith(f"{__package__}."):
                self.said = True
                logging.getLogger(__package__).warning(_COMPILING)

        def on_end(self, event: Any) -> None:
            """Say nothing."""

    event.register("numba:compile", _Announcer())

_COMPILING = "comwalk: compiling for this machine, once; it takes half a minute"

parallel_range = range if numba is None else numba.prange
"""The range of the outer loop of a batch, whose rounds may run side by side."""

COMPILES = numba is not None
"""Whether kernels are compiled here."""


def kernel(function: _Kernel) -> _Kernel:
    """Return a function compiled on its first call, with its result kept on disk.

    Args:
        function: A function of numbers and arrays alone.

    Returns:
        The compiled function; the function itself without numba.
    """
    if numba is None:
        return function
    compiled = numba.njit(cache=True, error_model="numpy", no_cfunc_wrapper=True)
    return cast(_Kernel, compiled(function))


def load(compiled: Any, *arguments: Any) -> None:
    """Load a kernel from disk, or compile it, without calling it.

    Args:
        compiled: The kernel.
        arguments: What it is going to be called with.
    """
    if numba is not None:
        compiled.compile(tuple(numba.typeof(argument) for argument in arguments))


def batch_kernel(function: _Kernel) -> _Kernel:
    """Return a function compiled like a kernel, whose outer loop uses all cores.

    Its result does not depend on the number of cores.

    Args:
        function: A function of numbers and arrays with a loop over `parallel_range`.

    Returns:
        The compiled function; the function itself without numba.
    """
    if numba is None:
        return function
    compiled = numba.njit(cache=True, error_model="numpy", parallel=True)
    return cast(_Kernel, compiled(function))
