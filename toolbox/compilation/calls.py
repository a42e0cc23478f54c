"""Calls of machine code at raw addresses from compiled loops, and arrays lent to them without counting references."""

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


@intrinsic
def borrowed_all(typingctx, arrays):  # pragma: no cover - compiled
    """The same tuple, its arrays lent without reference counts: the caller keeps them alive, and the loop is spared an atomic operation per access."""

    def codegen(context, builder, sig, args):
        lent = []
        for kind, item in zip(sig.args[0].types, cgutils.unpack_tuple(builder, args[0]), strict=True):
            if isinstance(kind, types.Array):
                view = cgutils.create_struct_proxy(kind)(context, builder, value=item)
                view.meminfo = cgutils.get_null_value(view.meminfo.type)
                view.parent = cgutils.get_null_value(view.parent.type)
                item = view._getvalue()
            lent.append(item)
        return context.make_tuple(builder, sig.return_type, lent)

    return arrays(arrays), codegen
