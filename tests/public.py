"""What is public: the functions and classes that the faces of the packages reach."""

import importlib
import inspect
from pathlib import Path

import controllers
import models
import toolbox
from toolbox.faces import public_names

ROOMS = [importlib.import_module(f"toolbox.{path.parent.name}") for path in sorted(Path(toolbox.__file__).parent.glob("*/__init__.py"))]
FACES = [toolbox, models, controllers, controllers.observers, *(room for room in ROOMS if hasattr(room, "__all__"))]

OWN = ("toolbox", "models", "controllers")


def reached(face, found):
    """Add {module and name: thing} of the public names of a face, and of the modules among them."""
    for name in public_names(face):
        thing = getattr(face, name)
        if inspect.ismodule(thing):
            if thing is not toolbox.authoring:
                reached(thing, found)
        elif (inspect.isfunction(thing) or inspect.isclass(thing)) and thing.__module__.startswith(OWN):
            found.setdefault(f"{thing.__module__}.{thing.__qualname__}", thing)
    return found


PUBLIC = {}
for each in FACES:
    reached(each, PUBLIC)
"""{module and name: function or class}."""


def docstring(thing):
    """The docstring of a function, or of a class itself: not that of an ancestor."""
    text = vars(thing).get("__doc__") if inspect.isclass(thing) else thing.__doc__
    return inspect.cleandoc(text or "")
