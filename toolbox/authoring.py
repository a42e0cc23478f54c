"""What authors of parts, laws and packages of their own build on, beside the names of `toolbox` itself.

Everything here is public: it changes only with a line in the changelog. `models` and `controllers` import nothing else of the toolbox.

    checks      is_finite_number, finite_array, check_fields, suggest, window
    symbols     State
    tables      Column, Table, read_table
    predictions Rollout, regularised, advance_rollout, time_left
    machine     cached, announced
    export      Declared, written
    control     zero_order_hold

What needs numba or the machinery of predictions is imported when it is first asked for, so that a part costs nothing but its equations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from toolbox.arguments import finite_array, is_finite_number
from toolbox.compilation.notices import announced
from toolbox.errors import suggest
from toolbox.export.c_code import Declared, written
from toolbox.files.tables import Column, Table
from toolbox.files.tables import read as read_table
from toolbox.modelling.components import check_fields
from toolbox.modelling.elements import State
from toolbox.modelling.regularisation import regularised
from toolbox.simulation.deadline import time_left
from toolbox.simulation.samples import window

if TYPE_CHECKING:
    from toolbox.compilation.numba_cache import cached
    from toolbox.prediction.rollout import Rollout
    from toolbox.prediction.rollout_loop import advance as advance_rollout
    from toolbox.robustness.loop import zero_order_hold

__all__ = [
    "Column",
    "Declared",
    "Rollout",
    "State",
    "Table",
    "advance_rollout",
    "announced",
    "cached",
    "check_fields",
    "finite_array",
    "is_finite_number",
    "read_table",
    "regularised",
    "suggest",
    "time_left",
    "window",
    "written",
    "zero_order_hold",
]


def __getattr__(name: str) -> Any:
    """A name that is imported when it is first asked for."""
    if name == "cached":
        from toolbox.compilation.numba_cache import cached

        return cached
    if name == "Rollout":
        from toolbox.prediction.rollout import Rollout

        return Rollout
    if name == "advance_rollout":
        from toolbox.prediction.rollout_loop import advance

        return advance
    if name == "zero_order_hold":
        from toolbox.robustness.loop import zero_order_hold

        return zero_order_hold
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
