"""Parts by name: everything that the packages registered under the entry-point group `stickslip.parts` offer to scenes.

A name is a class or a ready-made part, perhaps behind a module: `BitRock`, `wells.NAVARRO_LOPEZ_4`, `SoftTorque`; the name of the entry point may lead
(`models.BitRock`), and must where two packages use one name. Only parts, control laws, friction laws and ready-made parts can be reached, through
modules of the registered package, and through public names only: a scene file is data, and cannot name anything else.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from toolbox.contacts.problem import ContactBody
from toolbox.errors import SceneError, suggest
from toolbox.files.reading import opened
from toolbox.messages import complaint
from toolbox.modelling.components import Component
from toolbox.modelling.elements import FrictionLaw
from toolbox.modelling.laws import Controller
from toolbox.vocabulary import NOW

GROUP = "stickslip.parts"

KINDS = ("part", "contact body", "control law", "friction law")


@dataclass(frozen=True)
class Entry:
    """An entry of the catalogue: its shortest name, its kind out of KINDS, its class or ready-made part, and its module."""

    name: str
    kind: str
    item: Any
    source: str

    @property
    def summary(self) -> str:
        """First paragraph of the docstring of the class, or the class of a ready-made part."""
        if not isinstance(self.item, type):
            return f"ready-made {type(self.item).__name__}"
        return " ".join((self.item.__doc__ or "").strip().partition("\n\n")[0].split())

    @property
    def parameters(self) -> list[tuple[str, str, Any, str]]:
        """(name, unit, value or default, meaning) of every field; the unit of a field that is no quantity is empty."""
        out = []
        for spec in dataclasses.fields(self.item):
            if spec.name != "name":
                out.append((spec.name, spec.metadata.get("unit", ""), present(self.item, spec), spec.metadata.get("meaning", "")))
        return out


def part(name: str, kind: str | None = None) -> Any:
    """Return the class or ready-made part with a name, of any kind or of the given kind. SceneError is raised, with the nearest names, if
    there is none."""
    if not isinstance(name, str):
        raise SceneError(f"The name of a {kind or 'part'} must be text, but it is {name!r}.")
    found = offered(name)
    now = None if found else former_class(name)
    if now is not None:
        complaint(f"note: `{name}` is now `{now}`.", 0)
        return part(now, kind)
    if not found and not _packages()[0]:
        raise SceneError(
            f"There is no {kind or 'part'} `{name}`, because no package offers any: pip install -e . in the folder of the toolbox registers its parts."
        )
    fitting = [entry for entry in found if kind in (None, entry.kind)]
    if len({id(entry.item) for entry in fitting}) > 1:
        choices = " or ".join(f"`{entry.source}.{entry.name}`" for entry in fitting)
        raise SceneError(f"The name `{name}` must be unique, but several packages offer it: write {choices}.")
    if fitting:
        return fitting[0].item
    if found:
        raise SceneError(f"`{name}` must be a {kind}, but it is a {found[0].kind}: {suggest(name, _names(kind))}")
    broken = "".join(f" The parts of `{source}` cannot be loaded: {reason}." for source, reason in _packages()[1].items())
    raise SceneError(
        f"There is no {kind or 'part'} `{name}`: {suggest(name, _names(kind))}{broken} One of your own needs its file: `--load FILE.py`."
    )


def former_class(name: str) -> str | None:
    """Return the present name of a renamed class, with its package if the name had it; None for any other name."""
    package, _, last = name.rpartition(".")
    now = next((NOW[source, last] for source in _modules() if package in ("", source) and (source, last) in NOW), None)
    return now and f"{package}.{now}".removeprefix(".")


def offered(name: str) -> list[Entry]:
    """All that the packages offer under a name, without a look at anything else: much of the rest is only made when it is asked for."""
    found = []
    for source, module in _modules().items():
        for path in dict.fromkeys((name, name.removeprefix(f"{source}."))):
            place, seen = module, [module]
            *way, last = path.split(".")
            for step in way:
                inner = _public(place, step)
                if not _is_room(inner, module.__name__) or inner in seen:
                    break
                place = inner
                seen.append(inner)
            else:
                kind = _kind_offered(_public(place, last), module.__name__)
                if kind:
                    found.append(Entry(path, kind, _public(place, last), source))
    return found


def load_parts(path: str | Path) -> list[str]:
    """Offer the public parts, laws and friction laws of a Python file to scenes, which RUNS the file. A scene by itself never runs code.

    Parameters
    ----------
    path
        The file. Its name is that of the module, and its folder joins `sys.path`, so that worker processes find it, too.

    Returns
    -------
    list of str
        The names that scenes may use now.

    Raises
    ------
    SceneError
        For a file that cannot be read or run, one whose name is no word or that of another module, and one that offers nothing.
    """
    file = Path(path).resolve()
    name = file.stem
    if file.suffix != ".py" or not name.isidentifier():
        raise SceneError(f"Argument `--load` must be a Python file such as `my_drive.py`, but it is `{path}`.")
    opened(file).close()
    if name not in _LOADED:
        known = importlib.util.find_spec(name)
        if known is not None and Path(known.origin or "").resolve() != file:
            raise SceneError(f"Argument `--load` must not have the name of another module, but `{name}` is one: rename `{path}`.")
        spec = importlib.util.spec_from_file_location(name, file)
        assert spec is not None and spec.loader is not None
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        sys.path.insert(0, str(file.parent))
        try:
            spec.loader.exec_module(module)
        except Exception as error:  # whatever the file raises
            sys.path.remove(str(file.parent))
            del sys.modules[name]
            raise SceneError(f"The file `{path}` cannot be loaded: {type(error).__name__}: {error}") from error
        _LOADED[name] = module
        _entries.cache_clear()
    found = [entry.name for entry in _entries() if entry.source == name]
    if not found:
        raise SceneError(
            f"The file `{path}` offers nothing: it must hold a Controller, a Component, a ContactBody or a FrictionLaw as a frozen dataclass."
        )
    return found


_LOADED: dict[str, ModuleType] = {}


def parts(kind: str | None = None) -> list[Entry]:
    """Return all catalogue entries, or the entries of a kind, each under its shortest name, in order of kind and name."""
    shortest: dict[int, Entry] = {}
    for entry in _entries():
        known = shortest.get(id(entry.item))
        if kind in (None, entry.kind) and (known is None or len(entry.name) < len(known.name)):
            shortest[id(entry.item)] = entry
    return sorted(shortest.values(), key=lambda entry: (KINDS.index(entry.kind), entry.name.lower()))


def name_of(cls: type) -> str:
    """Return the name by which scenes ask for a class. SceneError is raised if no package offers the class."""
    candidates = [entry for entry in offered(cls.__name__) if entry.item is cls] or [entry for entry in parts() if entry.item is cls]
    if not candidates:
        raise SceneError(
            f"{cls.__name__} must be in the catalogue to be written to a scene, but no package registered under `{GROUP}` offers it."
        )
    entry = candidates[0]
    clash = any(other.item is not cls for other in offered(entry.name))
    return f"{entry.source}.{entry.name}" if clash else entry.name


def _names(kind: str | None) -> list[str]:
    return [entry.name for entry in parts(kind)]


def present(item: Any, spec: dataclasses.Field[Any]) -> Any:
    """Return the value of a field of a ready-made part, or the default of the field of a class. MISSING if the class has no default."""
    if not isinstance(item, type):
        return getattr(item, spec.name)
    return spec.default_factory() if spec.default_factory is not dataclasses.MISSING else spec.default


@cache
def _packages() -> tuple[dict[str, ModuleType], dict[str, str]]:
    """Registered modules by name of their entry point, and what went wrong with those that cannot be imported."""
    loaded, broken = {}, {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        try:
            module = point.load()
        except Exception as error:  # whatever a broken package raises must not take the other packages along
            broken[point.name] = f"{type(error).__name__}: {error}"
            continue
        if isinstance(module, ModuleType):
            loaded[point.name] = module
        else:
            broken[point.name] = f"its entry point must name a module, but it names {module!r}"
    return loaded, broken


def _modules() -> dict[str, ModuleType]:
    return {**_packages()[0], **_LOADED}


@cache
def _entries() -> list[Entry]:
    return [
        Entry(name, kind, item, source)
        for source, module in _modules().items()
        for name, kind, item in _walk(module, "", module.__name__, (module,))
    ]


def _walk(module: ModuleType, prefix: str, package: str, seen: tuple[ModuleType, ...]) -> Iterator[tuple[str, str, Any]]:
    """(name, kind, item) of everything public in a module and, through it, in modules of the same package."""
    for name in getattr(module, "__all__", sorted(vars(module))):
        item = _public(module, name)
        if _is_room(item, package):
            if item not in seen:
                yield from _walk(item, f"{prefix}{name}.", package, (*seen, item))
        elif kind := _kind_offered(item, package):
            yield f"{prefix}{name}", kind, item


def _public(module: ModuleType, name: str) -> Any:
    """What a module offers under a public name; None where it offers nothing."""
    offers = not name.startswith("_") and name in getattr(module, "__all__", vars(module))
    return getattr(module, name, None) if offers else None


def _is_room(item: Any, package: str) -> bool:
    """Whether something is a module of a package."""
    return isinstance(item, ModuleType) and item.__name__.startswith(package + ".")


def _kind_offered(item: Any, package: str) -> str | None:
    """The kind of what a package may offer: its own classes, and ready-made parts."""
    owner = (item if isinstance(item, type) else type(item)).__module__
    return _kind(item) if not isinstance(item, type) or owner == package or owner.startswith(package + ".") else None


def _kind(item: Any) -> str | None:
    """The kind of a class or a ready-made part, None for everything else."""
    if not isinstance(item, type):
        if isinstance(item, ContactBody):
            return "contact body"
        return "part" if isinstance(item, Component) and not isinstance(item, Controller) else None
    if not dataclasses.is_dataclass(item) or item in (Component, ContactBody, Controller, FrictionLaw):
        return None
    for base, kind in ((Controller, "control law"), (Component, "part"), (ContactBody, "contact body"), (FrictionLaw, "friction law")):
        if issubclass(item, base):
            return kind
    return None
