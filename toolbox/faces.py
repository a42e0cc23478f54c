"""Public names of packages: each is imported when it is first used, so that a script pays for what it uses.

A package writes each public name once, in a stub file `__init__.pyi` beside its `__init__.py`, where mypy and editors look for it:

    from .motor import Motor as Motor

Its `__init__.py` says

    __getattr__, __dir__, __all__ = face(__name__, __file__)

The stub is read by `lazy_loader` (SPEC 1 of Scientific Python), which asks for relative imports from files of the package itself.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any, NoReturn

import lazy_loader


def face(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` for a package whose public names stand in a stub file.

    If a name is not public in the package itself but in one of its sub-packages or public modules, the error message
    contains the correct import line. An import statement raises ImportError. Access to an attribute, such as `hasattr`,
    raises AttributeError.

    Parameters
    ----------
    package, file
        `__name__` and `__file__` of the package.

    Returns
    -------
    function, function, list of str
        `__getattr__`, `__dir__` and `__all__`.

    Examples
    --------
    >>> import toolbox.page
    >>> from toolbox.authoring import face
    >>> __getattr__, __dir__, __all__ = face(toolbox.page.__name__, toolbox.page.__file__)
    >>> print(len(__all__), "names")
    2 names
    """
    find, names, listed = lazy_loader.attach_stub(package, file)
    public = frozenset(listed)

    def __getattr__(name: str) -> Any:
        if name in public:
            return find(name)
        if name.startswith("_"):
            refuse(package, name)
        if find_spec(f"{package}.{name}"):
            return import_module(f"{package}.{name}")
        refuse(package, name, place_of(package, public, name) or _similar(package, public, name), sys._getframe(1).f_code.co_name)

    return __getattr__, names, listed


def refuse(package: str, name: str, where: str = "", caller: str = "") -> NoReturn:
    """Raise the error for a missing name of a package. `where` is a sentence with the right place of the name, and `caller` the function
    that asks.

    In an import statement it is an ImportError: of an AttributeError Python would take the type alone, and not its text.
    """
    if where and caller == "_handle_fromlist":
        raise ImportError(where)
    raise AttributeError(f"module {package!r} has no attribute {name!r}" + (where and f": {where}"))


def place_of(package: str, public: Collection[str], name: str) -> str:
    """Return a sentence that says from which package to import a name: a room, a public module, or the package around a room. Empty if no
    package has the name."""
    from pkgutil import iter_modules  # here, because few programs need it

    from toolbox.vocabulary import NOW  # here, too

    now = NOW.get((package, name))
    if now is not None:
        return f"`{name}` is now `{now}`: " + (f"write `from {package} import {now}`." if now in public else place_of(package, public, now))
    around = package.rpartition(".")[0]
    if around:  # a room: what it has not may have moved to another one
        public, package = public_names(sys.modules[around]), around
        if name in public:
            return f"`{name}` is in `{package}`: write `from {package} import {name}`."
    rooms = [room.name for room in iter_modules(sys.modules[package].__path__) if room.ispkg]
    modules = {
        place: import_module(place) for place in (f"{package}.{each}" for each in (*rooms, *sorted(public))) if find_spec(place) is not None
    }
    having = [place for place, module in modules.items() if name in public_names(module)]
    having = having or [place for place, module in modules.items() if hasattr(module, "__path__") and find_spec(f"{place}.{name}")]
    return f"`{name}` is in `{having[0]}`: write `from {having[0]} import {name}`." if having else ""


def _similar(package: str, public: Collection[str], name: str) -> str:
    """The question whether a similar public name was meant; empty for no similar name."""
    from difflib import get_close_matches  # here, too

    near = get_close_matches(name, public, n=1, cutoff=0.75)
    return f"there is no `{name}` in `{package}`: did you mean `{near[0]}`?" if near else ""


def warn_of_hidden(*packages: str) -> None:
    """Warn of files and folders that Python finds in place of packages beside the toolbox: an import from there fails and does not say why."""
    folder = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))  # `pathlib` would cost a sixth of the time of `import toolbox`
    for package in packages:
        home = os.path.join(folder, package)
        spec = find_spec(package)
        places = [] if spec is None else [place for place in (*(spec.submodule_search_locations or ()), spec.origin) if place]
        if (
            os.path.isdir(home)
            and places
            and not any(os.path.normcase(os.path.realpath(place) + os.sep).startswith(os.path.normcase(home + os.sep)) for place in places)
        ):
            import warnings

            text = f"`{places[-1]}` hides the package `{package}` of the toolbox, which cannot be imported: rename it, or start Python elsewhere."
            warnings.warn(text, stacklevel=3)


def public_names(module: ModuleType) -> list[str]:
    """Return the public names of a package, by its face. For a public module without `__all__`, return the functions and classes defined
    there."""
    listed = getattr(module, "__all__", None)
    defined = (name for name, thing in vars(module).items() if callable(thing) and getattr(thing, "__module__", "") == module.__name__)
    return [name for name in defined if not name.startswith("_")] if listed is None else list(listed)
