"""Calls of machine code at raw addresses from compiled loops."""

from __future__ import annotations

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def call(typingctx, address, t, h, x, k, p, m, y):  # pragma: no cover - compiled
    """Call void f(double, double, x, k, p, m, y) at a raw address; the arrays are passed by their data pointers."""
    signature = types.void(types.int64, types.float64, types.float64, x, k, p, m, y)

    def codegen(context, builder, sig, args):
        from llvmlite import ir

        pointer = ir.IntType(8).as_pointer()
        double = ir.DoubleType()
        data = [
            builder.bitcast(cgutils.create_struct_proxy(sig.args[i])(context, builder, value=args[i]).data, pointer) for i in range(3, 8)
        ]
        kind = ir.FunctionType(ir.VoidType(), [double, double] + [pointer] * 5)
        function = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(function, [args[1], args[2], *data])
        return context.get_dummy_value()

    return signature, codegen
