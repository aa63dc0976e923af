"""Four numbers as one value: a grid node's entries move through the processor together.

A numba type whose data model is LLVM's <4 x double> or <4 x float>, as in the array that they are loaded from.
LLVM splits it where the processor has narrower registers. The compiler finds this form by itself only now and then;
written down, it halves the transfer loops (measured 2026-11-21).

The functions below are intrinsics: a kernel passes values, and the function gets their numba types and returns the
signature and what builds the instructions. `Parameters` describe the values, annotations the types.

With NUMBA_DISABLE_JIT=1, four numbers are a NumPy array, and a product and a sum are rounded one after the other.
"""

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

_SCALARS = {types.float32: (ir.FloatType(), "f32"), types.float64: (ir.DoubleType(), "f64")}


class Lanes(types.Type):
    """The type of four numbers of `dtype`, float32 or float64."""

    def __init__(self, dtype):
        self.dtype = dtype
        self.scalar, self.suffix = _SCALARS[dtype]
        self.vector = ir.VectorType(self.scalar, 4)
        super().__init__(name=f"Lanes({dtype})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, kind.vector)


def _meaning(plain):
    """Decorator of instructions for the compiler; kernels that run as plain Python call `plain` instead."""
    return (lambda instructions: plain) if numba.config.DISABLE_JIT else intrinsic


def _four_of(array, index):
    """Four numbers of the flat `array`; NaN for those behind its end, which no result may depend on."""
    found = array.reshape(-1)[index : index + 4]
    if found.size == 4:
        return found.copy()
    four = np.full(4, np.nan, array.dtype)
    four[: found.size] = found
    return four


def _set(array, place, value):
    """Set an entry or a slice of the flat `array`."""
    array.reshape(-1)[place] = value


def _lanes_of(array):
    """The Lanes that a contiguous array of floats is loaded as; None of any other."""
    return Lanes(array.dtype) if isinstance(array, types.Array) and array.dtype in _SCALARS else None


def _splat(builder, kind, scalar):
    """Lanes of one scalar."""
    nothing = ir.Constant(kind.vector, ir.Undefined)
    first = builder.insert_element(nothing, scalar, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(ir.IntType(32), 4), [0, 0, 0, 0]))


def _multiply_add(builder, kind, factor, vector, total):
    """factor * vector + total with one rounding, wherever it is compiled."""
    signature = ir.FunctionType(kind.vector, [kind.vector] * 3)
    fused = cgutils.get_or_insert_function(builder.module, signature, f"llvm.fma.v4{kind.suffix}")
    return builder.call(fused, [factor, vector, total])


@_meaning(lambda a, b, c, d: np.array((a, b, c, d)))
def lanes(typingctx: Any, a: types.Type, b: types.Type, c: types.Type, d: types.Type) -> tuple:
    """Make Lanes of four floats: of float32 if all of them are.

    Parameters
    ----------
    a : float
    b : float
    c : float
    d : float
    """
    kind = Lanes(types.float32 if {a, b, c, d} == {types.float32} else types.float64)

    def codegen(context, builder, signature, arguments):
        value = ir.Constant(kind.vector, ir.Undefined)
        for k, scalar in enumerate(arguments):
            value = builder.insert_element(value, scalar, ir.Constant(ir.IntType(32), k))
        return value

    return kind(*[kind.dtype] * 4), codegen


@_meaning(lambda value, index: value[index])
def lane(typingctx: Any, value: types.Type, index: types.Type) -> tuple | None:
    """Take the float in one lane.

    Parameters
    ----------
    value : Lanes
    index : int
        A literal 0 to 3.
    """
    if not isinstance(index, types.IntegerLiteral):
        return None
    place = index.literal_value

    def codegen(context, builder, signature, arguments):
        return builder.extract_element(arguments[0], ir.Constant(ir.IntType(32), place))

    return value.dtype(value, index), codegen


@_meaning(lambda factor, value, total: factor * value + total)
def multiply_add(typingctx: Any, factor: types.Type, value: types.Type, total: types.Type) -> tuple:
    """Compute factor * value + total of one precision.

    Parameters
    ----------
    factor : float
    value : Lanes
    total : Lanes
    """

    def codegen(context, builder, signature, arguments):
        return _multiply_add(builder, value, _splat(builder, value, arguments[0]), arguments[1], arguments[2])

    return value(value.dtype, value, value), codegen


@_meaning(lambda a, b, factor, total: factor * a * b + total)
def multiply_lanes(typingctx: Any, a: types.Type, b: types.Type, factor: types.Type, total: types.Type) -> tuple:
    """Compute factor * a * b + total, lane by lane, of one precision.

    Parameters
    ----------
    a : Lanes
    b : Lanes
    factor : float
    total : Lanes
    """

    def codegen(context, builder, signature, arguments):
        a, b, factor, total = arguments
        scaled = builder.fmul(a, _splat(builder, signature.return_type, factor))
        fused = ir.FunctionType(signature.return_type.vector, [signature.return_type.vector] * 3)
        name = f"llvm.fma.v4{signature.return_type.suffix}"
        return builder.call(cgutils.get_or_insert_function(builder.module, fused, name), [scaled, b, total])

    return a(a, a, a.dtype, a), codegen


@_meaning(lambda value: np.append(value[:3], value.dtype.type(0.0)))
def without_last(typingctx: Any, value: types.Type) -> tuple:
    """Replace the fourth lane by zero.

    Parameters
    ----------
    value : Lanes
    """

    def codegen(context, builder, signature, arguments):
        zero = ir.Constant(value.scalar, 0.0)
        return builder.insert_element(arguments[0], zero, ir.Constant(ir.IntType(32), 3))

    return value(value), codegen


def _bytes(array):
    """Bytes of an array's entry, to which its entries are aligned."""
    return array.dtype.bitwidth // 8


def _pointer(context, builder, kind, array, index):
    """Pointer to the Lanes at flat `index` of a contiguous array of floats."""
    struct = context.make_array(kind)(context, builder, array)
    place = builder.gep(struct.data, [index], inbounds=True)
    return builder.bitcast(place, _lanes_of(kind).vector.as_pointer())


@_meaning(_four_of)
def load(typingctx: Any, array: types.Type, index: types.Type) -> tuple | None:
    """Load Lanes at a flat position of an array; without bounds checks.

    Parameters
    ----------
    array : float32[...] or float64[...], C-contiguous
    index : int
    """
    kind = _lanes_of(array)
    if kind is None:
        return None

    def codegen(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], *arguments)
        return builder.load(pointer, align=_bytes(array))

    return kind(array, types.intp), codegen


def _place(context, builder, kind, array, line, index, step=1):
    """Pointer to array.flat[line + step * index]; in this form the compiler sees the stride of loops over `index`."""
    struct = context.make_array(kind)(context, builder, array)
    start = builder.gep(struct.data, [line], inbounds=True)
    if step > 1:
        start = builder.bitcast(start, ir.ArrayType(struct.data.type.pointee, step).as_pointer())
    return builder.gep(start, [index], inbounds=True)


@_meaning(lambda array, line, index: array.reshape(-1)[line + index])
def get(typingctx: Any, array: types.Type, line: types.Type, index: types.Type) -> tuple:
    """Return array.flat[line + index]; without bounds checks.

    Parameters
    ----------
    array : float32[...] or float64[...], C-contiguous
    line : int
    index : int
    """

    def codegen(context, builder, signature, arguments):
        return builder.load(_place(context, builder, signature.args[0], *arguments), align=_bytes(array))

    return array.dtype(array, types.intp, types.intp), codegen


def _entry_of_group(size):
    """Code of `get_of_four` and `get_of_three`: load one number of a group of `size`."""

    def codegen(context, builder, signature, arguments):
        group = _place(context, builder, signature.args[0], *arguments[:3], step=size)
        within = ir.Constant(ir.IntType(32), signature.args[3].literal_value)
        place = builder.gep(group, [ir.Constant(ir.IntType(32), 0), within], inbounds=True)
        return builder.load(place, align=_bytes(signature.args[0]))

    return codegen


@_meaning(lambda array, line, index, entry: array.reshape(-1)[line + 4 * index + entry])
def get_of_four(
    typingctx: Any, array: types.Type, line: types.Type, index: types.Type, entry: types.Type
) -> tuple | None:
    """Return array.flat[line + 4 index + entry]; without bounds checks.

    Parameters
    ----------
    array : float32[...] or float64[...], C-contiguous
    line : int
    index : int
    entry : int
        A literal 0 to 3.
    """
    if not isinstance(entry, types.IntegerLiteral):
        return None
    return array.dtype(array, types.intp, types.intp, entry), _entry_of_group(4)


@_meaning(lambda array, line, index, entry: array.reshape(-1)[line + 3 * index + entry])
def get_of_three(
    typingctx: Any, array: types.Type, line: types.Type, index: types.Type, entry: types.Type
) -> tuple | None:
    """Return array.flat[line + 3 index + entry]; without bounds checks.

    Parameters
    ----------
    array : float32[...] or float64[...], C-contiguous
    line : int
    index : int
    entry : int
        A literal 0 to 2.
    """
    if not isinstance(entry, types.IntegerLiteral):
        return None
    return array.dtype(array, types.intp, types.intp, entry), _entry_of_group(3)


@_meaning(lambda array, line, index, value: _set(array, line + index, value))
def put(typingctx: Any, array: types.Type, line: types.Type, index: types.Type, value: types.Type) -> tuple:
    """Set array.flat[line + index] = value; without bounds checks.

    Parameters
    ----------
    array : float32[...] or float64[...], C-contiguous
    line : int
    index : int
    value : float
    """

    def codegen(context, builder, signature, arguments):
        place = _place(context, builder, signature.args[0], *arguments[:3])
        builder.store(arguments[3], place, align=_bytes(array))
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, array.dtype), codegen


@_meaning(lambda array, line, index, *values: _set(array, slice(line + 4 * index, line + 4 * index + 4), values))
def put_four(
    typingctx: Any,
    array: types.Type,
    line: types.Type,
    index: types.Type,
    a: types.Type,
    b: types.Type,
    c: types.Type,
    d: types.Type,
) -> tuple:
    """Set array.flat[line + 4 index : line + 4 index + 4] = a, b, c, d; without bounds checks.

    Parameters
    ----------
    array : float32[...] or float64[...], C-contiguous
    line : int
    index : int
    a : float
    b : float
    c : float
    d : float
    """

    def codegen(context, builder, signature, arguments):
        group = _place(context, builder, signature.args[0], *arguments[:3], step=4)
        for k, value in enumerate(arguments[3:]):
            at = builder.gep(group, [ir.Constant(ir.IntType(32), 0), ir.Constant(ir.IntType(32), k)], inbounds=True)
            builder.store(value, at, align=_bytes(array))
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, *[array.dtype] * 4), codegen


@_meaning(lambda *values: tuple(np.stack(values, 1)))
def transposed(typingctx: Any, a: types.Type, b: types.Type, c: types.Type, d: types.Type) -> tuple:
    """Turn four Lanes into four others: the first of each, the second of each, and so on.

    Parameters
    ----------
    a : Lanes
    b : Lanes
    c : Lanes
    d : Lanes
    """

    def codegen(context, builder, signature, arguments):
        a, b, c, d = arguments

        def mixed(left, right, places):
            mask = ir.Constant(ir.VectorType(ir.IntType(32), 4), places)
            return builder.shuffle_vector(left, right, mask)

        low_ab, high_ab = mixed(a, b, [0, 4, 2, 6]), mixed(a, b, [1, 5, 3, 7])
        low_cd, high_cd = mixed(c, d, [0, 4, 2, 6]), mixed(c, d, [1, 5, 3, 7])
        turned = (
            mixed(low_ab, low_cd, [0, 1, 4, 5]),
            mixed(high_ab, high_cd, [0, 1, 4, 5]),
            mixed(low_ab, low_cd, [2, 3, 6, 7]),
            mixed(high_ab, high_cd, [2, 3, 6, 7]),
        )
        return context.make_tuple(builder, signature.return_type, turned)

    return types.UniTuple(a, 4)(a, a, a, a), codegen


@_meaning(lambda array, index, value: _set(array, slice(index, index + 4), value))
def store(typingctx: Any, array: types.Type, index: types.Type, value: types.Type) -> tuple:
    """Set array.flat[index : index + 4] = value; without bounds checks.

    Parameters
    ----------
    array : float32[...] or float64[...], C-contiguous
    index : int
    value : Lanes
    """

    def codegen(context, builder, signature, arguments):
        pointer = _pointer(context, builder, signature.args[0], arguments[0], arguments[1])
        builder.store(arguments[2], pointer, align=_bytes(array))
        return context.get_dummy_value()

    return types.void(array, types.intp, _lanes_of(array)), codegen


@_meaning(lambda array, index: None)
def prefetch(typingctx: Any, array: types.Type, index: types.Type) -> tuple:
    """Prefetch the cache line of array.flat[index].

    Parameters
    ----------
    array : float32[...] or float64[...], C-contiguous
    index : int
    """

    def codegen(context, builder, signature, arguments):
        struct = context.make_array(signature.args[0])(context, builder, arguments[0])
        byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
        pointer = builder.bitcast(builder.gep(struct.data, [arguments[1]]), byte)
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(ir.VoidType(), [byte, word, word, word]), "llvm.prefetch.p0"
        )
        builder.call(function, [pointer, ir.Constant(word, 0), ir.Constant(word, 3), ir.Constant(word, 1)])
        return context.get_dummy_value()

    return types.void(array, types.intp), codegen
