"""Notation of SIMD functions: `@simd`, with memory as `Rows` and named tuples as `Fields`.

    @simd(returns=types.void)
    def scale(factor, setup):
        setup.plane32[STEP_X] = setup.plane32[STEP_X] * factor

is called from a compiled loop as `scale(2.0, setup)`, and put in the place of the call. Memory is
passed by pointers (`pointer(array)`), since numba counts a reference to an array at each call.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from inspect import Parameter, Signature, signature
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from rastercov.kernels.raster_memory import CACHE_LINE, LANES
from rastercov.kernels.simd import LONG, WORD, Scalar, Vector, load, lookup

Location = int | Scalar


class Rows:
    """Memory from a pointer on: `rows[k]` is row k of `LANES` values, converted when stored."""

    def __init__(self, context: Any, builder: Any, pointer: Any) -> None:
        self.context, self.builder, self.pointer = context, builder, pointer

    @property
    def kind(self) -> Any:
        """LLVM type of a value."""
        return self.pointer.type.pointee

    def at(self, offset: Location) -> "Rows":
        """Rows that start at a value; an offset of 0 adds no instruction."""
        index = LONG(offset) if isinstance(offset, int) else offset.to(LONG).value
        return Rows(self.context, self.builder, self.builder.gep(self.pointer, [index]))

    def _row(self, k: Location) -> Any:
        return self.at(k * LANES).pointer

    def __getitem__(self, k: Location) -> Vector:
        return load(self.builder, self._row(k), LANES)

    def __setitem__(self, k: Location, vector: Vector) -> None:
        vector.to(self.kind).store(self._row(k))

    def value(self, offset: Location) -> Scalar:
        """Value at an offset."""
        return Scalar(self.builder, self.builder.load(self.at(offset).pointer))

    def put(self, offset: Location, value: Scalar) -> None:
        """Store a value at an offset."""
        self.builder.store(value.to(self.kind).value, self.at(offset).pointer)

    def lane(self, row: int, k: Scalar) -> Vector:
        """Value k of a row, in every lane."""
        return self.value(k + row * LANES).broadcast(LANES)

    def lookup(self, n: int, index: Vector) -> Vector:
        """Values at `LANES` offsets, all less than n."""
        return lookup(self.context, self.pointer, n, index)

    def prefetch(self, offset: Location, is_written: bool = False) -> None:
        """Request the cache line of the value at an offset."""
        builder = self.builder
        byte_pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte_pointer, WORD, WORD, WORD])
        function = builder.module.declare_intrinsic("llvm.prefetch", [byte_pointer], kind)
        where = builder.bitcast(self.at(offset).pointer, byte_pointer)
        builder.call(function, [where, WORD(int(is_written)), WORD(3), WORD(1)])


class Fields:
    """A named tuple argument by the names of its fields."""

    def __init__(self, context: Any, builder: Any, value: Any, kind: Any) -> None:
        self._taken = context, builder, value, kind

    def __getattr__(self, name: str) -> Any:
        context, builder, value, kind = self._taken
        k = kind.fields.index(name)
        return _wrapped(context, builder, builder.extract_value(value, k), kind.types[k])


def _wrapped(context: Any, builder: Any, value: Any, kind: Any) -> Any:
    if isinstance(kind, types.BaseNamedTuple):
        return Fields(context, builder, value, kind)
    if isinstance(kind, types.CPointer):
        return Rows(context, builder, value)
    if isinstance(kind, types.NoneType):
        return None
    return Scalar(builder, value)


def simd(returns: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: a function of `Scalar`, `Rows` and `Fields`, callable from compiled loops.

    Integers arrive as 64 bits. A function returns nothing, a `Scalar`, or a tuple of these.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        def typed(typing: Any, *kinds: Any) -> Any:
            kinds = tuple(types.int64 if isinstance(k, types.Integer) else k for k in kinds)

            def generate(context: Any, builder: Any, typed_as: Any, values: Any) -> Any:
                arguments = zip(values, typed_as.args, strict=True)
                result = function(*(_wrapped(context, builder, *pair) for pair in arguments))
                if result is None:
                    return context.get_dummy_value()
                if isinstance(result, tuple):
                    values = [one.value for one in result]
                    return context.make_tuple(builder, typed_as.return_type, values)
                return result.value

            return returns(*kinds), generate

        typing = Parameter("typing", Parameter.POSITIONAL_OR_KEYWORD)
        parameters = signature(function).parameters.values()
        typed.__signature__ = Signature([typing, *parameters])  # type: ignore[attr-defined]
        typed.__name__, typed.__doc__ = function.__name__, function.__doc__
        return intrinsic(typed)

    return decorate


class Variable:
    """A value on the stack, for loops and branches: LLVM keeps it in a register."""

    def __init__(self, initial: Any) -> None:
        self._kind, self._builder = type(initial), initial.builder
        self._slot = cgutils.alloca_once_value(initial.builder, initial.value)

    @property
    def now(self) -> Any:
        """Current value."""
        return self._kind(self._builder, self._builder.load(self._slot))

    @now.setter
    def now(self, value: Any) -> None:
        self._builder.store(value.value, self._slot)


def loop(begin: Scalar, end: Scalar, step: Location) -> Any:
    """Context manager around the body of a loop; yields the 64-bit index."""

    @contextmanager
    def body() -> Iterator[Scalar]:
        builder = end.builder
        start, stop = begin.to(LONG).value, end.to(LONG).value
        stride = LONG(step) if isinstance(step, int) else step.to(LONG).value
        with cgutils.for_range_slice(builder, start, stop, stride, LONG) as (index, _):
            yield Scalar(builder, index)

    return body()


def when(condition: Scalar, likely: bool | None = None) -> Any:
    """Context manager around instructions of a branch."""
    return condition.builder.if_then(condition.value, likely=likely)


@intrinsic
def pointer(typing, array):
    """Pointer to the data of an array; None for None."""
    if isinstance(array, types.NoneType):
        return array(array), lambda context, *_: context.get_dummy_value()

    def generate(context, builder, signature, args):
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), generate


@intrinsic
def offset(typing, where, n):
    """Pointer to the element n after that of a pointer; None for None."""
    if isinstance(where, types.NoneType):
        return where(where, n), lambda context, *_: context.get_dummy_value()

    def generate(context, builder, signature, args):
        return builder.gep(args[0], [context.cast(builder, args[1], n, types.int64)])

    return where(where, n), generate


@intrinsic
def pointers(typing, record):
    """Named tuple of the same class, with a pointer for each array."""
    kinds = [types.CPointer(k.dtype) if isinstance(k, types.Array) else k for k in record.types]

    def generate(context, builder, signature, args):
        values = cgutils.unpack_tuple(builder, args[0])
        for k, kind in enumerate(record.types):
            if isinstance(kind, types.Array):
                values[k] = context.make_array(kind)(context, builder, values[k]).data
        return context.make_tuple(builder, signature.return_type, values)

    return types.NamedTuple(kinds, record.instance_class)(record), generate


@intrinsic
def align_stack(typing):
    """Align the stack of the calling loop to cache lines.

    LLVM spills vectors there. Its own alignment of 16 bytes puts most vectors of 64 bytes into two
    lines, which costs up to 5 %.
    """

    def generate(context, builder, signature, args):
        line = cgutils.alloca_once(builder, ir.VectorType(WORD, LANES))
        line.align = CACHE_LINE
        address = builder.bitcast(line, ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [address.type])
        builder.asm(kind, "", "r,~{memory}", [address], side_effect=True)  # keeps it there
        return context.get_dummy_value()

    return types.void(), generate


@simd(returns=types.void)
def prefetch_values(data, begin, end):
    """Request the cache lines of elements `begin` up to `end`."""
    size = data.context.get_abi_sizeof(data.kind)
    with loop(begin, end, CACHE_LINE // size) as at:
        data.prefetch(at)


@simd(returns=types.int64)
def append_set_bits(bit_indices, bits, base, listed, n):
    """Append base + index of each of `LANES` bits to a list of length n; returns its new length.

    Stream compaction without a branch, which would be mispredicted: `bit_indices` holds, for each
    byte, the indices of its set bits. Entries behind the new end are overwritten.
    """
    half = LANES // 2
    for k in range(2):
        byte = bits >> k * half & 0xFF
        indices = load(bits.builder, bit_indices.at(byte * half).pointer, half).zero_extended(WORD)
        (indices + (base + k * half)).store(listed.at(n).pointer)
        n = n + byte.count_bits()
    return n


@simd(returns=types.int64)
def count_bits(bits):
    """Number of set bits."""
    return bits.count_bits()


@simd(returns=types.int64)
def lowest_bit(bits):
    """Index of the lowest set bit of a number that is not 0."""
    return Scalar(bits.builder, bits.builder.cttz(bits.value, ir.Constant(ir.IntType(1), 1)))
