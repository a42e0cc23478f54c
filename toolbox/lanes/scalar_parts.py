"""What the lanes leave to the scalar loop: parts of it as machine code, and how the loop over the lanes calls them.

They are compiled as the scalar loop is (`toolbox.translation.compiled`), for a table of the arrays: of each its address, then its sizes.
"""

from __future__ import annotations

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from toolbox.compilation import work_layout
from toolbox.stepping.events import after_event, project_event
from toolbox.stepping.step_control import measure_round_off, spread_round_off
from toolbox.translation.compiled import Compiled


def _event(w, t):
    """What the scalar loop does with an event that has been stepped to; returns its status."""
    project_event(w, t, False)
    status = after_event(w, t)
    return work_layout.PAUSED if status == work_layout.DONE else status


event = Compiled(_event, work_layout.KINDS, "f")
measured = Compiled(measure_round_off, work_layout.KINDS)
spread = Compiled(spread_round_off, work_layout.KINDS, "f")


@intrinsic
def call_part(typingctx, address, w, number):  # pragma: no cover - compiled
    """Call a part of the scalar loop at a raw address with the arrays `w`, and a number or None; returns what it gives."""
    numbers = [] if isinstance(number, types.NoneType) else [types.float64]

    def codegen(context, builder, sig, args):
        from llvmlite import ir

        whole, pointer = ir.IntType(64), ir.IntType(8).as_pointer()
        kinds = sig.args[1].types
        table = cgutils.alloca_once(builder, whole, size=sum(1 + kind.ndim for kind in kinds))
        place = 0
        for i, kind in enumerate(kinds):
            array = cgutils.create_struct_proxy(kind)(context, builder, value=builder.extract_value(args[1], i))
            entries = [builder.ptrtoint(array.data, whole), *cgutils.unpack_tuple(builder, array.shape, kind.ndim)]
            for entry in entries:
                builder.store(entry, builder.gep(table, [ir.Constant(whole, place)]))
                place += 1
        given = [context.cast(builder, args[2], sig.args[2], each) for each in numbers]
        function = ir.FunctionType(whole, [pointer, *(ir.DoubleType() for _ in numbers)])
        return builder.call(builder.inttoptr(args[0], function.as_pointer()), [builder.bitcast(table, pointer), *given])

    return types.int64(types.int64, w, number), codegen
