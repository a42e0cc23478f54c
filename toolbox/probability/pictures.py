"""The method by which results of this room are drawn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def picture(function: str, words: str) -> Callable[..., Any]:
    """The method `plot` of a result, which a function of `toolbox.probability.figures` draws; words: what the picture shows."""

    def plot(self: Any, axes: Any = None) -> Any:
        from toolbox.probability import figures  # here, because matplotlib is slow to import

        return getattr(figures, function)(self, axes)

    plot.__doc__ = f"{words}. Return the axes.\n\nParameters\n----------\naxes\n    Axes to draw into. By default a new figure."
    return plot
