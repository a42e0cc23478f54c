"""What authors of parts, laws and packages of their own build on, beside the names of `toolbox` itself.

Everything here is public: it changes only with a line in the changelog. `models` and `controllers` import nothing else of the toolbox.

    checks      number, numbers, whole, array, entries, symmetric, is_finite_number, finite_array, in_si, NumberOrText, check_fields, suggest, window
    symbols     State
    files       Result, columns, Column, Table, read_table, read_arrays, read_mat, opened, replaced
    predictions Rollout, Motion, MOTION_KINDS, advance_rollout, advance_interval, regularised, time_left
    machine     Compiled, announced
    export      Declared, written
    pictures    paper, panels, line_styles, name_axis
    packages    face
    numerics    halved, zero_order_hold
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from toolbox import faces

if TYPE_CHECKING:
    from toolbox.arguments import array as array
    from toolbox.arguments import entries as entries
    from toolbox.arguments import finite_array as finite_array
    from toolbox.arguments import is_finite_number as is_finite_number
    from toolbox.arguments import number as number
    from toolbox.arguments import numbers as numbers
    from toolbox.arguments import symmetric as symmetric
    from toolbox.arguments import whole as whole
    from toolbox.compilation.notices import announced as announced
    from toolbox.errors import suggest as suggest
    from toolbox.export.law_text import Declared as Declared
    from toolbox.export.law_text import written as written
    from toolbox.faces import face as face
    from toolbox.figures.style import line_styles as line_styles
    from toolbox.figures.style import name_axis as name_axis
    from toolbox.figures.style import panels as panels
    from toolbox.figures.style import paper as paper
    from toolbox.files.archives import arrays as read_arrays  # noqa: F401 (public under this name)
    from toolbox.files.atomic import replaced as replaced
    from toolbox.files.mat import read_mat as read_mat
    from toolbox.files.printing import columns as columns
    from toolbox.files.reading import opened as opened
    from toolbox.files.results import Result as Result
    from toolbox.files.tables import Column as Column
    from toolbox.files.tables import Table as Table
    from toolbox.files.tables import read as read_table  # noqa: F401 (public under this name)
    from toolbox.files.units import NumberOrText as NumberOrText
    from toolbox.files.units import in_si as in_si
    from toolbox.halving import halved as halved
    from toolbox.modelling.components import check_fields as check_fields
    from toolbox.modelling.elements import State as State
    from toolbox.modelling.regularisation import regularised as regularised
    from toolbox.prediction.rollout import Rollout as Rollout
    from toolbox.prediction.rollout_loop import MOTION_KINDS as MOTION_KINDS
    from toolbox.prediction.rollout_loop import Motion as Motion
    from toolbox.prediction.rollout_loop import advance_interval as advance_interval
    from toolbox.prediction.rollout_loop import advance_rollout as advance_rollout
    from toolbox.simulation.deadline import time_left as time_left
    from toolbox.simulation.samples import window as window
    from toolbox.steady_states.linear_loop import zero_order_hold as zero_order_hold
    from toolbox.translation.compiled import Compiled as Compiled

__getattr__, __dir__ = faces.face()
