"""A word before something long is compiled, so that nobody takes the pause for a hang."""

from __future__ import annotations

from typing import Any

from toolbox.messages import LOG

_SAID: set[Any] = set()

LONG = 100_000
"""Instructions of a model from which on writing and optimising them is announced: 2 to 5 s."""


def announced(name: str, *functions: Any) -> bool:
    """Log that `name` is being compiled, unless this computer already has the machine code of all these functions.

    The check is made once per process and function.

    Parameters
    ----------
    name
        Text for the user.
    functions
        Functions that `Compiled` made.

    Returns
    -------
    bool
        Whether the message was logged.

    Examples
    --------
    >>> from toolbox.authoring import announced
    >>> print(announced("reader of nothing"), "with 0 functions")
    False with 0 functions
    """
    fresh = [function for function in functions if function not in _SAID]
    _SAID.update(fresh)
    if all(function.known() for function in fresh):
        return False
    LOG.info("compiling the %s, once per machine (some seconds) ...", name)
    return True


def announced_code(instructions: int) -> bool:
    """Report the number of instructions of a model if writing them takes seconds, and return whether it was reported."""
    if instructions > LONG:
        LOG.info("writing the equations as %s machine instructions ...", f"{instructions:,}")
    return instructions > LONG
