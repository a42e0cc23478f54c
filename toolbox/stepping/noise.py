"""Measurement noise: a standard normal number that is a function of channel and sample alone, so that every kind of run draws the same."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from toolbox.translation.compiled import Compiled


def scrambled(z):
    """The 64 bits of an unsigned integer scrambled: the finaliser of splitmix64."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def _key(seed, name):
    return scrambled(scrambled(np.uint64(seed) + np.uint64(0x9E3779B97F4A7C15)) ^ np.uint64(name))


_key_of = Compiled(_key, "u", "u", gives="u")


def channel_key(seed: int, name: int) -> np.uint64:
    """The key of a noise channel from a seed and the number of its name. A numpy scalar: a plain int would reach compiled code as a signed number."""
    return np.uint64(_key_of(seed, name))


def _normal(key, sample):
    """A standard normal number that is a function of a channel's key and the number of the sample alone (splitmix64, Box and Muller)."""
    counter = key + np.uint64(2 * sample + 1) * np.uint64(0x9E3779B97F4A7C15)
    radius = (float(scrambled(counter) >> np.uint64(11)) + 0.5) * 2.0**-53
    angle = float(scrambled(counter + np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(11)) * 2.0**-53
    return math.sqrt(-2.0 * math.log(radius)) * math.cos(2.0 * math.pi * angle)


def uniform(key, sample):
    """A number between 0 and 1 that is a function of a channel's key and the number of the sample alone."""
    counter = key + np.uint64(2 * sample + 1) * np.uint64(0x9E3779B97F4A7C15)
    return (float(scrambled(counter) >> np.uint64(11)) + 0.5) * 2.0**-53


class Channel(NamedTuple):
    """A channel of noise: its key, shape (1,), and room for its first numbers."""

    key: np.ndarray
    numbers: np.ndarray


def _normals(w):
    """Fill in the first numbers of a channel."""
    for k in range(w.numbers.size):
        w.numbers[k] = _normal(w.key[0], k)


normals = Compiled(_normals, {"key": ("uint64", 1), "numbers": ("float64", 1)})
"""The first standard normal numbers of a `Channel`, as machine code."""
normal = Compiled(_normal, "u", "i", gives="f")
"""A standard normal number of a channel's key and the number of a sample, as machine code."""
