"""Results of the runs of a sweep as columns, in memory and as blocks of neighbours on disk."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

WAITING, DONE, FAILED = 0, 1, 2
"""States of a run."""


@dataclass(frozen=True)
class Columns:
    """Results of all runs: values of the measures, shape (runs, measures), nan where there are none; status, shape (runs,): WAITING, DONE or FAILED; why."""

    values: np.ndarray
    status: np.ndarray
    errors: dict[int, str]

    @staticmethod
    def empty(runs: int, metrics: int) -> Columns:
        """Of runs that all wait."""
        return Columns(np.full((runs, metrics), np.nan), np.zeros(runs, np.uint8), {})

    def put(self, first: int, values: np.ndarray, errors: Mapping[int, str]) -> None:
        """Take in finished runs from the index `first` on."""
        self.values[first : first + len(values)] = values
        self.status[first : first + len(values)] = DONE
        failed = list(errors)
        self.values[failed], self.status[failed] = np.nan, FAILED
        self.errors.update(errors)


def chunk_shape(shape: tuple[int, ...], rows: int) -> tuple[int, ...]:
    """Return the shape of a block of at most `rows` neighbouring entries of an array: whole trailing axes, part of an axis, length 1 in the
    axes before."""
    block, room = [1] * len(shape), rows
    for k in reversed(range(len(shape))):
        if shape[k] > room:
            block[k] = math.ceil(shape[k] / math.ceil(shape[k] / room))  # parts of about the same length
            break
        block[k] = shape[k]
        room //= shape[k]
    return tuple(block)


def chunk_ranges(shape: tuple[int, ...], block: tuple[int, ...]) -> Iterator[tuple[int, int]]:
    """(first entry, behind the last one) of every block of that shape, in order."""
    cut = max((k for k in range(len(shape)) if block[k] < shape[k]), default=0)
    trailing = math.prod(shape[cut + 1 :])
    for before in range(math.prod(shape[:cut])):
        for first in range(0, shape[cut], block[cut]):
            start = (before * shape[cut] + first) * trailing
            yield start, start + min(block[cut], shape[cut] - first) * trailing
