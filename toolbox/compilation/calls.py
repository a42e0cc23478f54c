"""Calls of machine code at raw addresses from compiled loops."""

from __future__ import annotations

from numba import types
from numba.core import cgutils
from numba.core.datamodel.models import PrimitiveModel
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, register_model


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


class Lent(types.Type):
    """The type of a tuple of arrays that stands in the memory of the loop which lends it."""

    def __init__(self, owner: types.BaseTuple):
        self.owner = owner
        super().__init__(f"Lent({owner})")

    @property
    def key(self) -> types.BaseTuple:
        """What tells one from another."""
        return self.owner


@register_model(Lent)
class LentModel(PrimitiveModel):
    """Its value: where the tuple stands."""

    def __init__(self, manager, kind):
        super().__init__(manager, kind, cgutils.voidptr_t)


@infer_getattr
class LentAttributes(AttributeTemplate):
    """Its attributes are those of the tuple."""

    key = Lent

    def generic_resolve(self, value, attr):
        """The type of an attribute."""
        names = value.owner.instance_class._fields
        return value.owner.types[names.index(attr)] if attr in names else None


_OFFSETS: dict[types.BaseTuple, list[int]] = {}


def _offsets(context, owner):
    """Bytes from the begin of a tuple to each of its entries: an address in bytes is short where the type of the tuple, written out, is long."""
    if owner not in _OFFSETS:
        kind = context.get_value_type(owner)
        _OFFSETS[owner] = [kind.get_element_offset(context.target_data, i) for i in range(len(owner))]
    return _OFFSETS[owner]


@lower_getattr_generic(Lent)
def _attribute(context, builder, kind, value, attr):  # pragma: no cover - compiled
    place = kind.owner.instance_class._fields.index(attr)
    entry = context.get_value_type(kind.owner.types[place]).as_pointer()
    return builder.load(builder.bitcast(cgutils.pointer_add(builder, value, _offsets(context, kind.owner)[place]), entry))


@intrinsic
def lent(typingctx, arrays):  # pragma: no cover - compiled
    """The same tuple for functions that become a part of the loop: one pointer goes from one to the next, not all that is in the tuple.

    Handed on as it is, a tuple of fifty arrays is taken apart and put together again at every call, which is two thirds of what there is to compile.
    """
    if isinstance(arrays, Lent):
        return arrays(arrays), lambda context, builder, sig, args: args[0]

    def codegen(context, builder, sig, args):
        return builder.bitcast(cgutils.alloca_once_value(builder, args[0]), cgutils.voidptr_t)

    return Lent(arrays)(arrays), codegen


@intrinsic
def owned(typingctx, arrays):  # pragma: no cover - compiled
    """A lent tuple as it was, for a function that is called: it must not know where in the loop's memory the tuple stands, which then can be in registers."""
    if not isinstance(arrays, Lent):
        return arrays(arrays), lambda context, builder, sig, args: args[0]

    def codegen(context, builder, sig, args):
        return builder.load(builder.bitcast(args[0], context.get_value_type(sig.return_type).as_pointer()))

    return arrays.owner(arrays), codegen
