"""Vectors of numbers in compiled kernels, one for each mast abreast: a row of an array is loaded, computed with and stored whole.

Loops over so few lanes are not vectorised well, and outer loops over them not at all.  A vector is a number of a type of its
own here: ``load(rows, i) * load(other, j) + 2.0`` holds for all lanes, in one register of 512 bits or two of 256.  Sums may be
reordered and fused with products, as with ``FAST_DIVISION``; a lane has the same bits whatever the others hold.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import PrimitiveModel
from numba.core.extending import intrinsic as _intrinsic
from numba.core.extending import lower_builtin, register_model
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature

from cablepod._jit import FAST_DIVISION
from cablepod.mast._kernels_layout import ABREAST

intrinsic: Any = _intrinsic  # a kernel calls what it makes without the context of types
_FLAGS = tuple(sorted(FAST_DIVISION))
_DOUBLES = ir.VectorType(ir.DoubleType(), ABREAST)
_NUMBER = ir.IntType(32)


class Vector(types.Type):
    """Type of a vector."""

    def __init__(self) -> None:
        super().__init__(name=f"Vector{ABREAST}")


VECTOR = Vector()


@register_model(Vector)
class _VectorModel(PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _DOUBLES)


def _all_lanes(builder: Any, number: Any) -> Any:
    """Return a vector of equal numbers."""
    empty = ir.Constant(_DOUBLES, ir.Undefined)
    first = builder.insert_element(empty, number, ir.Constant(_NUMBER, 0))
    return builder.shuffle_vector(first, empty, ir.Constant(ir.VectorType(_NUMBER, ABREAST), [0] * ABREAST))


def _function(builder: Any, name: str) -> Any:
    """Return a function of LLVM that takes and returns a vector."""
    kind = ir.FunctionType(_DOUBLES, [_DOUBLES])
    return cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{ABREAST}f64")


def _pointer(context: Any, builder: Any, kind: Any, array: Any, row: Any) -> Any:
    """Return the address of a row of an array (rows, lanes)."""
    values = context.make_array(kind)(context, builder, array)
    zero = ir.Constant(row.type, 0)
    place = cgutils.get_item_pointer(context, builder, kind, values, [row, zero], wraparound=False, boundscheck=False)
    return builder.bitcast(place, _DOUBLES.as_pointer())


@intrinsic
def load(_: Any, rows: Any, i: Any) -> Any:
    """Return row `i` of an array (rows, lanes)."""

    def generate(context: Any, builder: Any, kind: Any, given: Any) -> Any:
        return builder.load(_pointer(context, builder, kind.args[0], *given), align=8)

    return signature(VECTOR, rows, types.intp), generate


@intrinsic
def store(_: Any, rows: Any, i: Any, vector: Any) -> Any:
    """Write row `i` of an array (rows, lanes)."""

    def generate(context: Any, builder: Any, kind: Any, given: Any) -> Any:
        builder.store(given[2], _pointer(context, builder, kind.args[0], *given[:2]), align=8)
        return context.get_dummy_value()

    return signature(types.void, rows, types.intp, VECTOR), generate


@intrinsic
def all_lanes(_: Any, number: Any) -> Any:
    """Return a vector of equal numbers."""

    def generate(context: Any, builder: Any, kind: Any, given: Any) -> Any:
        return _all_lanes(builder, given[0])

    return signature(VECTOR, types.float64), generate


@intrinsic
def root(_: Any, vector: Any) -> Any:
    """Return square roots."""

    def generate(context: Any, builder: Any, kind: Any, given: Any) -> Any:
        return builder.call(_function(builder, "sqrt"), given, fastmath=_FLAGS)

    return signature(VECTOR, VECTOR), generate


@intrinsic
def where_less(_: Any, a: Any, b: Any, x: Any, y: Any) -> Any:
    """Return x in the lanes where a < b, y in the others, those that are not numbers among them."""

    def generate(context: Any, builder: Any, kind: Any, given: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", given[0], given[1]), given[2], given[3])

    return signature(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR), generate


@intrinsic
def all_less(_: Any, a: Any, b: Any) -> Any:
    """Tell whether a < b in all lanes; not where a lane is not a number."""

    def generate(context: Any, builder: Any, kind: Any, given: Any) -> Any:
        bits = ir.IntType(ABREAST)
        less = builder.bitcast(builder.fcmp_ordered("<", given[0], given[1]), bits)
        return builder.icmp_unsigned("==", less, ir.Constant(bits, -1))

    return signature(types.boolean, VECTOR, VECTOR), generate


@intrinsic
def size_of(_: Any, vector: Any) -> Any:
    """Return magnitudes."""

    def generate(context: Any, builder: Any, kind: Any, given: Any) -> Any:
        return builder.call(_function(builder, "fabs"), given)

    return signature(VECTOR, VECTOR), generate


def _define(operation: Any, instruction: str) -> None:
    """Define an operation of vectors, and of vectors and numbers."""

    @infer_global(operation)
    class _Cases(ConcreteTemplate):
        cases = (
            signature(VECTOR, VECTOR, VECTOR),
            signature(VECTOR, VECTOR, types.float64),
            signature(VECTOR, types.float64, VECTOR),
        )

    @lower_builtin(operation, VECTOR, VECTOR)
    @lower_builtin(operation, VECTOR, types.float64)
    @lower_builtin(operation, types.float64, VECTOR)
    def _generate(context: Any, builder: Any, kind: Any, given: Any) -> Any:
        a, b = (
            value if own == VECTOR else _all_lanes(builder, value) for value, own in zip(given, kind.args, strict=True)
        )
        return getattr(builder, instruction)(a, b, flags=_FLAGS)


for _operation, _instruction in (
    (operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv"),
    (operator.iadd, "fadd"), (operator.isub, "fsub"), (operator.imul, "fmul"),
):  # fmt: skip
    _define(_operation, _instruction)
