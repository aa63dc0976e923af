"""Four doubles as one value: a grid node's entries move through the processor together.

A numba type whose data model is LLVM's <4 x double>. LLVM splits it where the processor has narrower registers. The
compiler finds this form by itself only now and then; written down, it halves the transfer loops (measured 2026-11-21).
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

_VECTOR = ir.VectorType(ir.DoubleType(), 4)


class Lanes(types.Type):
    """The type of four doubles."""

    def __init__(self):
        super().__init__(name="Lanes")


lanes_type = Lanes()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _VECTOR)


def _splat(builder, scalar):
    """<4 x double> of one scalar."""
    first = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(
        first, ir.Constant(_VECTOR, ir.Undefined), ir.Constant(ir.VectorType(ir.IntType(32), 4), [0, 0, 0, 0])
    )


def _multiply_add(builder, factor, vector, total):
    """factor * vector + total with one rounding, wherever it is compiled."""
    fused = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_VECTOR, [_VECTOR] * 3), "llvm.fma.v4f64")
    return builder.call(fused, [factor, vector, total])


@intrinsic
def lanes(typingctx, a, b, c, d):
    """Lanes(a, b, c, d) of four floats."""

    def codegen(context, builder, signature, arguments):
        value = ir.Constant(_VECTOR, ir.Undefined)
        for k, scalar in enumerate(arguments):
            value = builder.insert_element(value, scalar, ir.Constant(ir.IntType(32), k))
        return value

    return lanes_type(types.float64, types.float64, types.float64, types.float64), codegen


@intrinsic
def lane(typingctx, value, index):
    """The float in lane `index`, a literal 0 to 3."""
    if not isinstance(index, types.IntegerLiteral):
        return None
    place = index.literal_value

    def codegen(context, builder, signature, arguments):
        return builder.extract_element(arguments[0], ir.Constant(ir.IntType(32), place))

    return types.float64(lanes_type, index), codegen


@intrinsic
def multiply_add(typingctx, factor, value, total):
    """factor * value + total, for a float and two Lanes."""

    def codegen(context, builder, signature, arguments):
        return _multiply_add(builder, _splat(builder, arguments[0]), arguments[1], arguments[2])

    return lanes_type(types.float64, lanes_type, lanes_type), codegen


def _pointer(context, builder, kind, array, index):
    """Pointer to <4 x double> at flat `index` of a contiguous float64 array."""
    struct = context.make_array(kind)(context, builder, array)
    place = builder.gep(struct.data, [index])
    return builder.bitcast(place, _VECTOR.as_pointer())


@intrinsic
def load(typingctx, array, index):
    """Lanes at flat position `index` of a C-contiguous float64 array; nobody checks the bounds."""

    def codegen(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], *arguments)
        return builder.load(pointer, align=8)

    return lanes_type(array, types.intp), codegen


@intrinsic
def add_to(typingctx, array, index, value):
    """array.flat[index : index + 4] += value, for a C-contiguous float64 array; nobody checks the bounds."""

    def codegen(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], arguments[0], arguments[1])
        old = builder.load(pointer, align=8)
        builder.store(builder.fadd(old, arguments[2]), pointer, align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type), codegen
