"""The vocabulary of the public interface: each term, what it means, and the former names that it replaced.

A former name is refused with the new one: as an argument (`new_names_only`), as an attribute or a field (`Renamed`), as an option of a command, and as
the name of a class or a command. Files keep their meaning: result files and scenes with former names load (`new_field`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from inspect import CO_VARKEYWORDS
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from toolbox.errors import SceneError, suggest
from toolbox.former_names import ENTRIES

NOW = {(place, entry.old): entry.new for entry in ENTRIES for place in entry.places.split()}
"""{(place, former name): name now}."""

Arguments = ParamSpec("Arguments")
Found = TypeVar("Found")


def refuse_former_names(place: str, words: Any) -> None:
    """Raise SceneError for the first word that is a former name in that place, with the name now."""
    for word in words:
        if (place, word) in NOW:
            raise SceneError(f"Argument `{word}` of `{place}` is now `{NOW[place, word]}`.")


def now_or_near(place: str, word: str, known: Iterable[str]) -> str:
    """Return the end of an error message about an unknown name: the name now of a former one, or the nearest known names."""
    names = list(known)
    return f"it is now `{NOW[place, word]}`." if NOW.get((place, word)) in names else suggest(word, names)


def new_names_only(function: Callable[Arguments, Found]) -> Callable[Arguments, Found]:
    """Return the function with a check that refuses former names of its arguments. The error names the present name.

    Parameters
    ----------
    function
        Function whose renamed arguments have entries in the vocabulary, under the name of the function.

    Returns
    -------
    function
        The function, with this check before each call.

    Examples
    --------
    >>> from toolbox.authoring import new_names_only
    >>> @new_names_only
    ... def hopf_curve(second_parameter):
    ...     return 2 * second_parameter
    >>> hopf_curve(second_parameter=3)
    6
    >>> hopf_curve(over=3)
    Traceback (most recent call last):
    toolbox.errors.SceneError: Argument `over` of `hopf_curve` is now `second_parameter`.
    """

    @functools.wraps(function)
    def checked(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Found:
        refuse_former_names(function.__name__, kwargs)
        return function(*args, **kwargs)

    return checked


def new_field(kind: type | str, word: str) -> str:
    """Return the present name of a field of a class; the same word if it was never renamed.

    Parameters
    ----------
    kind
        The class, or its name. Entries of the ancestors of a class hold for it, too.
    word
        Name of the field, perhaps a former one.

    Returns
    -------
    str
        The present name.

    Examples
    --------
    >>> from models import GaussianStribeck
    >>> from toolbox.authoring import new_field
    >>> print(new_field(GaussianStribeck, "speed"), len(new_field(GaussianStribeck, "static")))
    stribeck_speed 6
    """
    names = [kind] if isinstance(kind, str) else [each.__name__ for each in kind.__mro__]
    return next((NOW[name, word] for name in names if (name, word) in NOW), word)


class Renamed:
    """Base class that refuses former names of arguments and attributes of its subclasses. The error names the present name.

    Examples
    --------
    >>> from models import GaussianStribeck
    >>> from toolbox import SceneError
    >>> try:
    ...     GaussianStribeck(speed=0.1)
    ... except SceneError as error:
    ...     print(error)
    Argument `speed` of `GaussianStribeck` is now `stribeck_speed`.
    """

    if not TYPE_CHECKING:  # a checker of types must see neither, or it takes every name for an attribute

        def __init_subclass__(cls, **kwargs: Any) -> None:
            """Refuse former names among the attributes that a subclass declares."""
            super().__init_subclass__(**kwargs)
            for word in vars(cls):
                if (now := new_field(cls.__mro__[1], word)) != word:
                    raise SceneError(f"Attribute `{word}` of `{cls.__name__}` is now `{now}`.")

        def __new__(cls, *args: Any, **kwargs: Any) -> Any:
            """Refuse former and unknown names of arguments."""
            for word in kwargs:
                if (now := new_field(cls, word)) != word and word not in getattr(cls, "__dataclass_fields__", {}):
                    raise SceneError(f"Argument `{word}` of `{cls.__name__}` is now `{now}`.")
            code = getattr(cls.__init__, "__code__", None)
            if code is not None and not code.co_flags & CO_VARKEYWORDS:
                known = code.co_varnames[1 : code.co_argcount + code.co_kwonlyargcount]
                for word in kwargs.keys() - set(known):
                    raise TypeError(f"{cls.__name__} has no argument `{word}`: {suggest(word, known)}")
            return super().__new__(cls)

        def __getattr__(self, name: str) -> Any:
            now = new_field(type(self), name)
            if now != name and not hasattr(type(self), name):
                raise AttributeError(f"`{name}` of `{type(self).__name__}` is now `{now}`.", name=name, obj=self)
            return object.__getattribute__(self, name)  # as it fails without this method
