"""All public names of the toolbox, its models and its controllers under one import name, which no other distribution has.

    import stickslip

    rig = stickslip.compose(stickslip.wells.NAVARRO_LOPEZ_4, stickslip.BitRock(weight="97.347 kN"))
    run = stickslip.simulate(rig, "60 s", inputs={"top.torque": "10 kN m"})

The names are those of `toolbox`, `models` and `controllers`; rooms of the toolbox are here as well, such as `stickslip.probability`.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import controllers
import models
import toolbox
from toolbox.faces import place_of, public_names, refuse

if TYPE_CHECKING:
    from controllers import *
    from models import *
    from toolbox import *

_HOMES = {name: face for face in (controllers, models, toolbox) for name in dir(face)}

__all__ = sorted(name for face in (toolbox, models, controllers) for name in public_names(face))
__path__: list[str] = []  # without one an import statement would not say in which room a name is


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        globals()[name] = found = getattr(_HOMES[name], name)
        return found
    if not name.startswith("_") and hasattr(toolbox, name):  # a room
        return getattr(toolbox, name)
    places = () if name.startswith("_") else (toolbox, controllers)
    where = next(filter(None, (place_of(face.__name__, public_names(face), name) for face in places)), "")
    return refuse(__name__, name, where, sys._getframe(1).f_code.co_name)


def __dir__() -> list[str]:
    return [*__all__, "time", "__version__"]
