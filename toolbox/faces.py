"""The faces of packages: names that are imported when they are first asked for, so that a script pays for what it uses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any


def face(
    package: dict[str, Any], files: Mapping[str, str], modules: Sequence[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the `__getattr__` and `__dir__` of a package or module.

    Parameters
    ----------
    package
        Its `globals()`.
    files
        {file: what is imported from it, as an import statement would say it: "BitRock" or "read as read_table, Column"}.
    modules
        Public modules of the package.
    """
    homes = {name: (file, own) for file, names in files.items() for own, name in imported(names).items()}

    def find(name: str) -> Any:
        if name in modules:
            return import_module(f"{package['__name__']}.{name}")
        if name not in homes:
            raise AttributeError(f"module {package['__name__']!r} has no attribute {name!r}")
        file, own = homes[name]
        found = package[name] = getattr(import_module(file), own)
        return found

    def names() -> list[str]:
        return sorted({*package, *homes, *modules})

    return find, names


def imported(names: str) -> dict[str, str]:
    """{own name in the file: public name} of what an import statement names."""
    pairs = [each.split(" as ") for each in names.split(", ")]
    return {pair[0]: pair[-1] for pair in pairs}
