"""Tables of uses that are refused: a row holds the use, words of the message, which name the argument, and the kind of the error if it is no SceneError."""

from inspect import signature

import pytest

from toolbox import SceneError


def refusals(*rows):
    """Return a test of each row `(use, words)` or `(use, words, error)`; a parameter of a use without a default is a fixture."""

    @pytest.mark.parametrize(("use", "words", "error"), [(*row, SceneError)[:3] for row in rows], ids=[row[1] or None for row in rows])
    def refused(use, words, error, request):
        fixtures = [name for name, parameter in signature(use).parameters.items() if parameter.default is parameter.empty]
        with pytest.raises(error, match=words or None):
            use(**{name: request.getfixturevalue(name) for name in fixtures})

    return refused


def each_of(use, words, values, error=SceneError):
    """Return a row for each value that a use refuses in the same words; a use of several arguments has a tuple of them."""
    several = len(signature(use).parameters) > 1
    return [(lambda value=value: use(*value) if several else use(value), words, error) for value in values]
