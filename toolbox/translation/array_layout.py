"""Where an array of numpy has its address, sizes and numbers in memory, as it is laid down for every program in C that uses one."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np

HEADER = object.__basicsize__
"""Bytes of what begins every object of Python, with its type at their end; behind it an array of numpy has what the next lines say."""

TYPE, DATA, DIMENSIONS, SIZES, DTYPE, FLAGS = HEADER - 8, HEADER, HEADER + 8, HEADER + 16, HEADER + 40, HEADER + 48
ORDER, NUMBER = HEADER + 10, HEADER + 12
"""Of a type of numbers: the order of its bytes, and which one it is."""

ITEMS = tuple.__basicsize__
UNFIT = -(2**63)
"""What a loop gives where its arrays are not of the kinds that were said."""

ARRAY = id(np.ndarray)
"""The type of arrays, as it stands in every array."""


@cache
def check_layout() -> None:
    """Raise RuntimeError if the arrays of numpy have another memory layout than this file describes."""
    tried: tuple[np.ndarray, ...] = (np.zeros((3, 5)), np.zeros(7, np.int8), np.zeros((4, 4))[:, 1:])
    for array, item in zip(tried, (ctypes.c_void_p * 3).from_address(id(tried) + ITEMS), strict=True):
        data, sizes, dtype = (ctypes.c_void_p.from_address(item + at).value or 0 for at in (DATA, SIZES, DTYPE))
        dimensions, flags = (ctypes.c_int32.from_address(item + at).value for at in (DIMENSIONS, FLAGS))
        found = (item, data, dimensions, flags & 1, ctypes.c_void_p.from_address(item + TYPE).value)
        if found != (id(array), array.ctypes.data, array.ndim, array.flags.c_contiguous, ARRAY) or (
            tuple((ctypes.c_int64 * array.ndim).from_address(sizes)) != array.shape
            or ctypes.c_int32.from_address(dtype + NUMBER).value != array.dtype.num
            or ctypes.c_char.from_address(dtype + ORDER).value.decode() != array.dtype.byteorder
        ):
            raise RuntimeError(f"Arrays of numpy {np.__version__} are laid out otherwise than the compiled loops know.")
