"""Results of a study in files: every field of a frozen dataclass by its annotation, checked when it is read, and never run as code."""

from __future__ import annotations

import dataclasses
import json
import math
import statistics
import types
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from toolbox.errors import SceneError, no_array
from toolbox.files import tables
from toolbox.files.archives import arrays, understood
from toolbox.files.atomic import replaced
from toolbox.files.printing import Printed
from toolbox.vocabulary import new_field

Self = TypeVar("Self", bound="Result")
HeadedRows = tuple[Sequence[str], Sequence[Sequence[Any]]]
"""Headings and rows of a table."""

LEFT_OUT = {"saved": False}
"""Metadata of a field that belongs to the machine at hand: it is not written, and None in a result that was loaded."""

FUNCTIONS = {
    f"{each.__module__}.{each.__qualname__}": each for each in (max, min, sum, statistics.fmean, statistics.mean, statistics.median)
}
"""Functions that a field may hold."""


class Result(Printed):
    """Base class of results that can be saved and loaded. A subclass is a frozen dataclass whose fields are numbers,
    texts, arrays and dataclasses of these.

    The annotations of its fields must be known at run time.

    Examples
    --------
    >>> from controllers import PI
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, margins
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), PI(proportional=400.0, integral=200.0, reference="120 rpm"))
    >>> found = margins(loop)
    >>> again = type(found).load(found.save("margins.npz"))
    >>> print(again.disk_margin == found.disk_margin, f"{again.disk_margin:.2f}")
    True 1.24
    """

    def save(self, path: str | Path) -> Path:
        """Write the result to a file, atomically.

        The file is an npz file without pickle, which `load` reads, or a table if the path ends with .csv.

        Parameters
        ----------
        path
            Path of the file.

        Returns
        -------
        Path
            The same path.
        """
        path = Path(path)
        if path.suffix == ".csv":
            return self.to_csv(path)
        found: dict[str, np.ndarray] = {}
        tree = {"kind": type(self).__name__, "fields": written(self, found)}
        with replaced(path) as file:
            np.savez_compressed(file, result=np.array(json.dumps(tree)), **found)  # type: ignore[arg-type]
        return path

    def to_csv(self, path: str | Path) -> Path:
        """Write the table of the result as CSV in SI units, atomically.

        Parameters
        ----------
        path
            Path of the file.

        Returns
        -------
        Path
            The same path.
        """
        return tables.write(path, *self._table())

    def _table(self) -> HeadedRows:
        """Headings and rows of that table."""
        raise NotImplementedError

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        arrays = [f"`{each.name}`" for each in dataclasses.fields(self) if isinstance(getattr(self, each.name), np.ndarray)]  # type: ignore[arg-type]
        no_array(self, f"take one of its fields{', such as ' if arrays else ''}{', '.join(arrays[:3])}")

    @classmethod
    def load(cls: type[Self], path: str | Path) -> Self:
        """Read a result from an npz file of `save`.

        Parameters
        ----------
        path
            Path of the file.

        Raises
        ------
        SceneError
            If the file was not written by `save` of a result of this class.
        """
        path, kind = Path(path), cls.__name__
        what = f"a file written by `{kind}.save`"
        with understood(path, what):
            found = arrays(path, what)
            tree = json.loads(str(found["result"])) if "result" in found else {"kind": kind, "fields": cls._earlier(found)}
            if tree["kind"] != kind:
                raise ValueError(f"it holds a result of the kind {tree['kind']}")
            loaded: Self = read(cls, tree["fields"], found, kind)
            loaded.check_loaded()
        return loaded

    @classmethod
    def _earlier(cls, found: Mapping[str, np.ndarray]) -> Mapping[str, Any]:
        """The fields, as `written` makes them, of a file of an earlier version with these arrays; KeyError where there was no other form."""
        raise KeyError("result")

    def check_loaded(self) -> None:
        """Raise ValueError if the loaded arrays do not fit together."""


def as_data(value: Any) -> Any:
    """A result as JSON can say it, for other programs: dataclasses and mappings as objects, arrays as lists, nan as null, and what is infinite as text."""
    if isinstance(value, np.ndarray | np.generic):
        return as_data(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None if math.isnan(value) else str(value)
    if isinstance(value, complex):
        return [as_data(value.real), as_data(value.imag)]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = (each.name for each in dataclasses.fields(value) if each.metadata.get("saved", True))
        return {name: as_data(getattr(value, name)) for name in fields}
    if hasattr(value, "_asdict"):
        return as_data(value._asdict())
    if isinstance(value, Mapping):
        return {key if isinstance(key, str) else json.dumps(as_data(key)): as_data(each) for key, each in value.items()}
    if isinstance(value, tuple | list | set | frozenset):
        return [as_data(each) for each in value]
    return value if value is None or isinstance(value, bool | int | str) else getattr(value, "__qualname__", None) or str(value)


def written(value: Any, arrays: dict[str, np.ndarray], name: str = "array") -> Any:
    """Return a value for JSON, and add its arrays to `arrays`. The name of an array gives its place, such as `array.smooth.severity`."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return name
    if isinstance(value, complex):
        return [value.real, value.imag]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            each.name: written(getattr(value, each.name), arrays, f"{name}.{each.name}")
            for each in dataclasses.fields(value)
            if each.metadata.get("saved", True)
        }
    if isinstance(value, Mapping):
        return [[written(key, arrays), written(each, arrays, f"{name}.{key}")] for key, each in value.items()]
    if isinstance(value, tuple | list):
        return [written(each, arrays, f"{name}.{i}") for i, each in enumerate(value)]
    if callable(value):
        name = f"{value.__module__}.{value.__qualname__}"
        if FUNCTIONS.get(name) is not value:
            raise SceneError(f"A result with the function {value!r} cannot be saved: a file holds one of {', '.join(FUNCTIONS)}.")
        return name
    return value


def read(kind: Any, given: Any, arrays: Mapping[str, np.ndarray], word: str) -> Any:
    """Return a value of the annotated kind from the result of `written`. ValueError is raised for another kind; `word` names the value in
    the message."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        if given is None and type(None) in inner:
            return None
        kind = next(each for each in inner if each is not type(None))
        origin, inner = get_origin(kind), get_args(kind)
    if not _fits(kind, origin, given):
        raise ValueError(f"its `{word}` is {given!r}")
    if dataclasses.is_dataclass(kind):
        return _read_fields(kind, given, arrays)
    if kind is np.ndarray or origin is np.ndarray:
        return arrays[given]
    if kind is complex:
        return complex(*given)
    if origin is tuple:
        own = [inner[0]] * len(given) if inner[-1] is Ellipsis else inner
        return tuple(read(each, value, arrays, word) for each, value in zip(own, given, strict=True))
    if origin in (dict, Mapping):
        return {read(inner[0], key, arrays, word): read(inner[1], each, arrays, word) for key, each in given}
    if origin is Callable:
        return FUNCTIONS[given]
    if kind is Any:
        return arrays[given] if isinstance(given, str) and given.startswith("array.") else given
    return kind(given)


def _fits(kind: Any, origin: Any, given: Any) -> bool:
    """Whether what a file holds can be a value of a kind; a whole number may stand for a float."""
    held: type = dict if dataclasses.is_dataclass(kind) else list if kind is complex or origin in (tuple, dict, Mapping) else object
    number = kind is float and type(given) is int
    return isinstance(given, held) and (kind not in (bool, int, float, str) or type(given) is kind or number)


def _read_fields(kind: Any, given: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Any:
    """A dataclass of its fields; one with a default may be absent, so that files of earlier versions are read."""
    hints, fields = get_type_hints(kind), {each.name: each for each in dataclasses.fields(kind)}
    given = {word if word in fields else new_field(kind, word): each for word, each in given.items()}
    for name in given:
        if name not in fields:
            raise ValueError(f"it has `{name}`, which is not known here")
    values = {name: None for name, each in fields.items() if not each.metadata.get("saved", True)}
    for name, each in fields.items():
        if name in given:
            values[name] = read(hints[name], given[name], arrays, name)
        elif name not in values and each.default is dataclasses.MISSING and each.default_factory is dataclasses.MISSING:
            raise KeyError(name)
    return kind(**values)
