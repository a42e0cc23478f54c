"""A word before something long is compiled, so that nobody takes the pause for a hang."""

from __future__ import annotations

from typing import Any

from toolbox.messages import LOG

_SAID: set[Any] = set()

LONG = 100_000
"""Instructions of a model from which on writing and optimising them is announced: 2 to 5 s."""


def announced(name: str, *functions: Any) -> bool:
    """Say that `name` is being compiled, unless this machine already has the machine code of all these functions.

    It is asked once per process, because machine code that is loaded is there.

    Parameters
    ----------
    name
        What the user reads.
    functions
        Functions made by `cached`, or that have a method `known`.

    Returns
    -------
    bool
        Whether it was said.
    """
    fresh = [function for function in functions if function not in _SAID]
    _SAID.update(fresh)
    if not fresh:
        return False
    new = [function for function in fresh if not _known(function)]
    if not new:
        return False
    LOG.info("compiling the %s, once per machine (%s) ...", name, "up to a minute" if any(map(_of_numba, new)) else "some seconds")
    return True


def _known(function: Any) -> bool:
    """Whether a compiled function needs no compiling here."""
    if _of_numba(function):
        from toolbox.compilation.numba_cache import known

        return known(function)
    return bool(function.known())


def _of_numba(function: Any) -> bool:
    """Whether numba compiles a function, which takes long; another one says itself whether it is known."""
    return not hasattr(function, "known")


def announced_code(instructions: int) -> bool:
    """Say that the equations of a model are being written in so many instructions, where that takes seconds; returns whether it was said."""
    if instructions > LONG:
        LOG.info("writing the equations as %s machine instructions ...", f"{instructions:,}")
    return instructions > LONG
