"""Kernels: plain functions of numbers and arrays, compiled on their first call.

A kernel stands beside the object that it computes for and is the only code of its
formula. Its result is kept on disk for the next process. numba itself is imported on
the first call of a kernel, since that import takes longer than a short command; so
modules with kernels may be imported anywhere. With the environment variable
NUMBA_DISABLE_JIT=1 kernels run as plain Python, for debuggers and coverage.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import logging
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np

_Function = TypeVar("_Function", bound=Callable[..., Any])
Record = Any
"""One record of an array, or a field of it, as kernels see it."""

_COMPILING = "comwalk: compiling for this machine, once; it takes half a minute"


def kernel(function: _Function) -> _Function:
    """Return a function that is compiled on its first call.

    Args:
        function: A function of numbers and arrays alone; it may call other kernels.

    Returns:
        A `Kernel`, which is called like the function.
    """
    return cast(_Function, Kernel(function, no_cfunc_wrapper=True))


def batch_kernel(function: _Function) -> _Function:
    """Return a function compiled like a kernel, whose outer loop uses all cores.

    Its result does not depend on the number of cores.

    Args:
        function: A function of numbers and arrays with a loop over `parallel_range`.

    Returns:
        A `Kernel`, which is called like the function.
    """
    return cast(_Function, Kernel(function, parallel=True))


class Kernel:
    """A function that numba compiles when it is first called. Final."""

    def __init__(self, function: Callable[..., Any], **options: Any) -> None:
        """Keep the function for later.

        Args:
            function: What to compile.
            options: More options of `numba.njit`.
        """
        functools.update_wrapper(self, function)
        self.py_func = function
        """The function as it is written."""
        self._options = options

    @functools.cached_property
    def dispatcher(self) -> Callable[..., Any]:
        """The compiled function, for callers that count every 0.1 us."""
        import numba

        if numba.config.DISABLE_JIT:  # ty: ignore[missing-attribute]
            return lambda *arguments: self.py_func(*map(_with_attributes, arguments))
        _announce_compiling()
        compile_ = functools.partial(numba.njit, error_model="numpy", **self._options)
        try:
            compiled = compile_(cache=True)(self.py_func)
        except RuntimeError:  # there is no folder for it
            return compile_()(self.py_func)
        _keep_if_possible(compiled)
        return compiled

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return self.dispatcher(*arguments)

    @property
    def _numba_type_(self) -> Any:
        """The type by which kernels that call this one know it."""
        import numba

        return numba.typeof(self.dispatcher)


def _keep_if_possible(compiled: Any) -> None:
    """Have a kernel run that cannot be kept, as on a full disk."""
    keep = compiled._cache.save_overload

    def try_to_keep(*what: Any) -> None:
        with contextlib.suppress(OSError):
            keep(*what)

    compiled._cache.save_overload = try_to_keep


def _with_attributes(value: Any) -> Any:
    """Return records whose fields are attributes, as kernels see them, uncompiled."""
    if isinstance(value, np.ndarray) and value.dtype.names:
        return value.view(np.recarray)
    if isinstance(value, np.void) and not isinstance(value, np.record):
        address, size = value.__array_interface__["data"][0], value.dtype.itemsize
        memory = (ctypes.c_char * size).from_address(address)
        array = np.frombuffer(memory, value.dtype)  # ty: ignore[no-matching-overload]
        return array.view(np.recarray)[0]
    return value


def load(compiled: Any, *arguments: Any) -> Callable[..., Any]:
    """Load a kernel from disk, or compile it, without calling it.

    Args:
        compiled: The kernel.
        arguments: What it is going to be called with.

    Returns:
        What to call in a loop: the compiled function itself.
    """
    import numba

    if not numba.config.DISABLE_JIT:  # ty: ignore[missing-attribute]
        compiled.dispatcher.compile(tuple(numba.typeof(x) for x in arguments))
    return compiled.dispatcher


def records(dtype: np.dtype, count: int = 1) -> np.ndarray:
    """Return records, all zero.

    Args:
        dtype: What they are.
        count: How many.
    """
    return np.zeros(count, dtype)


@functools.cache
def _announce_compiling() -> None:
    """Have numba say once that compiling takes a while; loading stays quiet."""
    from numba.core import event

    class _Announcer(event.Listener):
        said = False

        def on_start(self, event: Any) -> None:
            module = event.data["dispatcher"].py_func.__module__
            if not self.said and module.startswith(f"{__package__}."):
                self.said = True
                logging.getLogger(__package__).warning(_COMPILING)

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:compile", _Announcer())


def __getattr__(name: str) -> Any:
    """Return `parallel_range`: the range of a batch kernel's outer loop."""
    if name != "parallel_range":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import numba

    return numba.prange
