"""Calls of machine code at raw addresses from compiled loops, and arrays lent to them without counting references."""

from __future__ import annotations

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from toolbox.compilation.loop_layout import Work
from toolbox.compilation.numba_cache import inlined


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
def borrowed(typingctx, array):  # pragma: no cover - compiled
    """The same array without its reference count: the caller keeps it alive, and the loop is spared an atomic operation per access."""

    def codegen(context, builder, sig, args):
        view = cgutils.create_struct_proxy(sig.args[0])(context, builder, value=args[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), codegen


@inlined
def borrowed_all(w):
    """The same arrays, all lent without their reference counts."""
    return Work(
        borrowed(w.ints),
        borrowed(w.reals),
        borrowed(w.x),
        borrowed(w.k),
        borrowed(w.p),
        borrowed(w.m),
        borrowed(w.y),
        borrowed(w.z),
        borrowed(w.s),
        borrowed(w.q),
        borrowed(w.scale),
        borrowed(w.noise),
        borrowed(w.group),
        borrowed(w.group_scale),
        borrowed(w.g),
        borrowed(w.g_low),
        borrowed(w.g_high),
        borrowed(w.guard_scale),
        borrowed(w.slot),
        borrowed(w.side),
        borrowed(w.armed),
        borrowed(w.fired),
        borrowed(w.excited),
        borrowed(w.zero),
        borrowed(w.forced),
        borrowed(w.before),
        borrowed(w.kind),
        borrowed(w.initial),
        borrowed(w.attached),
        borrowed(w.loader),
        borrowed(w.held),
        borrowed(w.bounced),
        borrowed(w.rec_t),
        borrowed(w.rec_x),
        borrowed(w.rec_m),
        borrowed(w.rec_p),
        borrowed(w.ev_t),
        borrowed(w.ev_i),
        borrowed(w.ev_m),
        borrowed(w.jump_t),
        borrowed(w.jump_first),
        borrowed(w.jump_index),
        borrowed(w.jump_value),
        borrowed(w.out_t),
        borrowed(w.samplers),
        borrowed(w.clocks),
        borrowed(w.memory),
        borrowed(w.keys),
        borrowed(w.queue),
    )
