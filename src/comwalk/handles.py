"""Many arrays of records as one argument of a kernel.

A call of a compiled function from Python costs some 0.1 us per array, and a tick needs
two dozen arrays that never move. A *handle* is one array with their addresses; the
kernel makes arrays of them again, at no cost. Whoever makes a handle keeps its arrays
alive.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numba
import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic

_FLOAT = np.dtype(np.float64)
UNCOMPILED = bool(numba.config.DISABLE_JIT)  # ty: ignore[missing-attribute]
"""Whether kernels run as plain Python, by the environment NUMBA_DISABLE_JIT=1."""

# Put into the callers: compiled by themselves, there would be one for each number k.
inlined = numba.njit(inline="always")


def handle_of(*arrays: np.ndarray) -> np.ndarray:
    """Return the addresses and lengths of contiguous arrays.

    Args:
        arrays: Arrays that outlive the handle, in the order that its kernel expects.

    Returns:
        Two integers for each.
    """
    numbers = [(array.ctypes.data, len(array)) for array in arrays]
    return np.array(numbers, dtype=np.int64).ravel()


@intrinsic
def _pointer(context: Any, address: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.inttoptr(values[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), generate


@inlined
def _array_at(address: int, count: int, dtype: Any) -> np.ndarray:
    return numba.carray(_pointer(address), (count,), dtype)  # ty: ignore[missing-argument]


if UNCOMPILED:

    def _array_at(address: int, count: int, dtype: np.dtype) -> np.ndarray:
        """Return the array at an address, no copy; records by their fields' names."""
        size = int(count) * dtype.itemsize
        if not size:
            return np.zeros(0, dtype)
        memory = (ctypes.c_char * size).from_address(int(address))
        array = np.frombuffer(memory, dtype)  # ty: ignore[no-matching-overload]
        return array.view(np.recarray) if dtype.names else array


@inlined
def records_at(handle: np.ndarray, k: int, dtype: Any) -> np.ndarray:
    """Return the k-th array of a handle.

    Args:
        handle: Made by `handle_of`.
        k: Which of its arrays.
        dtype: What its items are.

    Returns:
        The array itself, no copy.
    """
    return _array_at(handle[2 * k], handle[2 * k + 1], dtype)


@inlined
def floats_at(handle: np.ndarray, k: int) -> np.ndarray:
    """Return the k-th array of a handle, numbers."""
    return records_at(handle, k, _FLOAT)


@inlined
def record_at(address: int, dtype: Any) -> np.ndarray:
    """Return one record at an address, as an array of one."""
    return _array_at(address, 1, dtype)
