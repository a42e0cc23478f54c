"""What a law in Python remembers, as numbers: with these a run goes on from its end, and the growth of a disturbance is told from differences."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from toolbox.arguments import FloatArray
from toolbox.vocabulary import Renamed


class Stateful(Renamed):
    """Base class of an object whose memory can be saved and restored, such as a controller that is a Python callable.

    In a subclass, the class attribute `memory_fields` names exactly the attributes on which the next outputs depend.
    Such an attribute is a number, a truth value, an array of constant shape, or a part with a memory of its own. Truth
    values and integers are rounded when they are restored.

    Examples
    --------
    >>> from toolbox.modelling import Stateful
    >>> class Counter(Stateful):
    ...     memory_fields = ("count",)
    ...     count = 0
    ...
    ...     def __call__(self, t, y):
    ...         self.count += 1
    ...         return 100.0 * self.count
    >>> counter = Counter()
    >>> commands = [counter(0.1 * k, []) for k in range(3)]
    >>> print(commands, counter.get_memory())
    [100.0, 200.0, 300.0] [3.]
    """

    memory_fields: ClassVar[tuple[str, ...]] = ()

    def get_memory(self) -> FloatArray:
        """Return the present memory as one array of floats, shape (n,): the attributes of `memory_fields` in order."""
        parts = [getattr(self, name) for name in self.memory_fields]
        return np.concatenate(
            [np.empty(0), *[np.ravel(part.get_memory() if offers_memory(part) else part).astype(float) for part in parts]]
        )

    def set_memory(self, values: FloatArray) -> None:
        """Restore a memory that `get_memory` returned at this sample or at an earlier one.

        Parameters
        ----------
        values
            The array that `get_memory` returned, shape (n,).
        """
        place = 0
        for name in self.memory_fields:
            part = getattr(self, name)
            size = np.size(part.get_memory() if offers_memory(part) else part)
            own = np.array(values[place : place + size], float)
            place += size
            if offers_memory(part):
                part.set_memory(own)
            elif isinstance(part, np.ndarray):
                setattr(self, name, own.reshape(part.shape))
            else:
                setattr(self, name, type(part)(round(own[0]) if isinstance(part, int) else own[0]))


def offers_memory(law: Any) -> bool:
    """Return whether an object gives its memory by the methods `get_memory() -> array of numbers` and `set_memory(array)`."""
    return callable(getattr(law, "get_memory", None)) and callable(getattr(law, "set_memory", None))
