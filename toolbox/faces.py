"""The faces of packages: names that are imported when they are first asked for, so that a script pays for what it uses.

A package writes each public name once, where mypy and editors look for it:

    if TYPE_CHECKING:
        from mine.motor import Motor as Motor

    __getattr__, __dir__ = face()

Why the compiled imports are read, and not a list or a stub beside the file: they are there wherever the package is, in an archive and in a frozen program,
too, and reading them costs nothing that can be measured.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any


def face(*unlisted: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the `__getattr__` and `__dir__` of the package or module that calls it; `__all__` is given by the former.

    The public names are those that the caller imports below `if TYPE_CHECKING`. What a package takes from a package, not from a file, is a public module.
    A name that is public in a room of the package, or in one of its public modules, is refused with the line that imports it from there: an import statement
    by ImportError, what asks for an attribute, as `hasattr` does, by AttributeError.

    Parameters
    ----------
    unlisted
        Public names that a star import leaves out.
    """
    caller = sys._getframe(1)
    package, code = caller.f_globals, caller.f_code
    homes = cache(lambda: imports_for_types(code))

    def find(name: str) -> Any:
        if name == "__all__":
            found: Any = sorted(homes().keys() - set(unlisted))
        elif name in homes():
            file, own = homes()[name]
            home = import_module(file)
            found = import_module(f"{file}.{own}") if hasattr(home, "__path__") else getattr(home, own)
        elif "__path__" in package and not name.startswith("_"):
            return _below(package, homes(), name, sys._getframe(1))
        else:
            raise _unknown(package, name)
        package[name] = found
        return found

    def names() -> list[str]:
        return sorted({*package, *homes(), "__all__"})

    return find, names


def warn_of_hidden(*packages: str) -> None:
    """Say of packages beside the toolbox which file or folder Python finds in their place: an import from there fails and does not say why."""
    from importlib.util import find_spec

    for package in packages:
        home = Path(__file__).resolve().parents[1] / package
        spec = find_spec(package)
        places = [] if spec is None else [place for place in (*(spec.submodule_search_locations or ()), spec.origin) if place]
        if home.is_dir() and places and not any(Path(place).resolve().is_relative_to(home) for place in places):
            from toolbox.messages import LOG

            text = "`%s` hides the package `%s` of the toolbox, which cannot be imported: rename it, or start Python elsewhere."
            LOG.warning(text, places[-1], package)


def imports_for_types(code: CodeType) -> dict[str, tuple[str, str]]:
    """{public name: (file, name in the file)} of what a module imports below `if TYPE_CHECKING`, from its compiled code.

    Why not `dis.get_instructions`: it takes a millisecond for fifty names, this a twentieth.
    """
    from dis import opmap  # here, because all that a name is asked for imports it anyway

    module, name, store, load, extend = (opmap[each] for each in ("IMPORT_NAME", "IMPORT_FROM", "STORE_NAME", "LOAD_NAME", "EXTENDED_ARG"))
    found: dict[str, tuple[str, str]] = {}
    file = own = ""
    higher = 0
    for operation, lower in zip(code.co_code[::2], code.co_code[1::2], strict=True):
        index = higher | lower
        higher = index << 8 if operation == extend else 0
        if operation == load and code.co_names[index] == "TYPE_CHECKING":
            found.clear()  # what stands above is imported in any case
        elif operation == module:
            file = code.co_names[index]
        elif operation == name:
            own = code.co_names[index]
        elif operation == store and own:
            found[code.co_names[index]] = (file, own)
            own = ""
    return found


def public_names(module: ModuleType) -> list[str]:
    """The public names of a package or a public module: those of its face, or else the functions and classes that it defines."""
    listed = getattr(module, "__all__", None)
    defined = (name for name, thing in vars(module).items() if callable(thing) and getattr(thing, "__module__", "") == module.__name__)
    return [name for name in defined if not name.startswith("_")] if listed is None else list(listed)


def _below(package: dict[str, Any], homes: dict[str, tuple[str, str]], name: str, asking: FrameType) -> Any:
    """The file or room of that name; raises ImportError or AttributeError, as the frame asks for it, for what is in a room or public module of the package."""
    from importlib.util import find_spec  # here, because few programs need it
    from pkgutil import iter_modules

    if find_spec(f"{package['__name__']}.{name}"):
        return import_module(f"{package['__name__']}.{name}")
    places = [room.name for room in iter_modules(package["__path__"]) if room.ispkg]
    places += [public for public, (file, _) in homes.items() if getattr(find_spec(file), "submodule_search_locations", None)]
    modules = {place: import_module(place) for place in (f"{package['__name__']}.{each}" for each in places)}
    having = [place for place, module in modules.items() if name in public_names(module)]
    having = having or [place for place, module in modules.items() if hasattr(module, "__path__") and find_spec(f"{place}.{name}")]
    if having:
        told = f"`{name}` is in `{having[0]}`: write `from {having[0]} import {name}`."
        if _imports(asking):
            raise ImportError(told)
        raise _unknown(package, name, f": {told}")
    raise _unknown(package, name)


def _imports(frame: FrameType) -> bool:
    """Whether a frame is at the part of an import statement that takes a name from a module.

    Python itself would turn an AttributeError into an ImportError there, whose text does not tell where the name is.
    """
    from dis import opmap

    return frame.f_lasti >= 0 and frame.f_code.co_code[frame.f_lasti] == opmap["IMPORT_FROM"]


def _unknown(package: dict[str, Any], name: str, where: str = "") -> AttributeError:
    return AttributeError(f"module {package['__name__']!r} has no attribute {name!r}{where}")
