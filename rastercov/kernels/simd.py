"""Vector and scalar values over LLVM: operators from which LLVM generates SIMD instructions.

numba vectorises long and simple loops only, and the loops of a rasteriser are neither. So its
stages are written over `Vector`, inside functions that `simd_kernel.simd` makes callable from
compiled loops. Vectors of any length run on every processor: LLVM splits those longer than its
registers.
"""

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba.core import cgutils

MASK, WORD, LONG = ir.IntType(1), ir.IntType(32), ir.IntType(64)
SINGLE, DOUBLE = ir.FloatType(), ir.DoubleType()


def _operator(on_integers: str, on_floats: str = "") -> Callable[[Any, Any], Any]:
    """Operator on lanes, from the names of the builder's instructions."""

    def operate(one: Any, other: Any) -> Any:
        if isinstance(one, Scalar) and isinstance(other, (Vector, Sequence)):
            one = one.broadcast(len(other))
        operation = getattr(one.builder, on_floats if one.is_float else on_integers)
        return one._new(operation(one.value, one.like(other).value))

    return operate


def _comparison(sign: str) -> Callable[[Any, Any], Any]:
    """Mask of the lanes for which the comparison holds, never with NaN."""

    def compare(one: Any, other: Any) -> Any:
        comparison = one.builder.fcmp_ordered if one.is_float else one.builder.icmp_signed
        return one._new(comparison(sign, one.value, one.like(other).value))

    return compare


class Value:
    """Operators shared by vectors and scalars. Operands take the type of the other one.

    A number is a constant in every lane, a sequence one constant a lane; a scalar is broadcast.
    """

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    @property
    def kind(self) -> Any:
        """Type of one lane."""
        return self.value.type

    @property
    def is_float(self) -> bool:
        """Lanes are float32 or float64; otherwise integers or masks."""
        return self.kind in (SINGLE, DOUBLE)

    def _type_of(self, kind: Any) -> Any:
        """LLVM type of this shape with lanes of another type."""
        return kind

    def _new(self, value: Any) -> Any:
        return type(self)(self.builder, value)

    def like(self, other: Any) -> Any:
        """`other` in the type of these lanes."""
        raise NotImplementedError

    __add__ = _operator("add", "fadd")
    __sub__ = _operator("sub", "fsub")
    __mul__ = _operator("mul", "fmul")
    __truediv__ = _operator("sdiv", "fdiv")
    __rshift__ = _operator("ashr")
    __lshift__ = _operator("shl")
    __and__ = _operator("and_")
    __or__ = _operator("or_")
    __lt__ = _comparison("<")
    __le__ = _comparison("<=")
    __gt__ = _comparison(">")
    __ge__ = _comparison(">=")
    equals = _comparison("==")

    def __invert__(self) -> Any:
        return self._new(self.builder.not_(self.value))

    def __neg__(self) -> Any:
        return self.like(0) - self

    def where(self, mask: "Value", other: Any) -> Any:
        """Lanes of this value where the mask is set, of `other` elsewhere."""
        return self._new(self.builder.select(mask.value, self.value, self.like(other).value))

    def minimum(self, other: Any) -> Any:
        """Lesser of both lanes; of `other` where one is NaN."""
        return self.where(self < other, other)

    def maximum(self, other: Any) -> Any:
        """Greater of both lanes; of `other` where one is NaN."""
        return self.where(self > other, other)

    def to(self, kind: Any) -> Any:
        """Lanes converted to another type: floats to integers by truncation, masks to 0 and 1."""
        if kind == self.kind:
            return self
        from_float, to_float = self.is_float, kind in (SINGLE, DOUBLE)
        if from_float and to_float:
            change = self.builder.fptrunc if kind == SINGLE else self.builder.fpext
        elif from_float or to_float:
            change = self.builder.fptosi if from_float else self.builder.sitofp
        elif self.kind == MASK:
            change = self.builder.zext
        else:
            change = self.builder.trunc if kind.width < self.kind.width else self.builder.sext
        return self._new(change(self.value, self._type_of(kind)))


class Scalar(Value):
    """One value."""

    def like(self, other: Any) -> "Scalar":
        """`other` in the type of this value."""
        if isinstance(other, Scalar):
            other = other.to(self.kind).value
            return Scalar(self.builder, other)
        return Scalar(self.builder, self.kind(float(other) if self.is_float else other))

    def broadcast(self, n: int) -> "Vector":
        """Vector of n lanes of this value."""
        vector = ir.VectorType(self.kind, n)
        undefined = ir.Constant(vector, ir.Undefined)
        one = self.builder.insert_element(undefined, self.value, WORD(0))
        zeros = ir.Constant(ir.VectorType(WORD, n), [0] * n)
        return Vector(self.builder, self.builder.shuffle_vector(one, one, zeros))

    def as_mask(self, n: int) -> "Vector":
        """Mask of n lanes from the lowest n bits, lane 0 lowest."""
        bits = self.builder.trunc(self.value, ir.IntType(n))
        return Vector(self.builder, self.builder.bitcast(bits, ir.VectorType(MASK, n)))

    def count_bits(self) -> "Scalar":
        """Number of bits that are set."""
        return Scalar(self.builder, self.builder.ctpop(self.value))


class Vector(Value):
    """A value in each lane."""

    @property
    def kind(self) -> Any:
        """Type of one lane."""
        return self.value.type.element

    def _type_of(self, kind: Any) -> Any:
        return ir.VectorType(kind, len(self))

    def __len__(self) -> int:
        return int(self.value.type.count)

    def like(self, other: Any) -> "Vector":
        """`other` in the type and number of these lanes."""
        if isinstance(other, Vector):
            return other
        if isinstance(other, Scalar):
            scalar: Scalar = other.to(self.kind)
            return scalar.broadcast(len(self))
        numbers = other if isinstance(other, Sequence) else [other] * len(self)
        numbers = [float(number) if self.is_float else number for number in numbers]
        return Vector(self.builder, ir.Constant(self.value.type, numbers))

    def _call(self, operation: str, *others: "Vector") -> "Vector":
        """Result of an LLVM operation on vectors of floats."""
        vector, operands = self.value.type, [self.value, *(other.value for other in others)]
        name = f"llvm.{operation}.v{len(self)}f{32 if self.kind == SINGLE else 64}"
        kind = ir.FunctionType(vector, [vector] * len(operands))
        function = cgutils.get_or_insert_function(self.builder.module, kind, name)
        return Vector(self.builder, self.builder.call(function, operands))

    def floor(self) -> "Vector":
        """Greatest integer not above."""
        return self._call("floor")

    def sqrt(self) -> "Vector":
        """Square root."""
        return self._call("sqrt")

    def absolute(self) -> "Vector":
        """Absolute value."""
        return self._call("fabs")

    def sign(self) -> "Vector":
        """1 with the sign of each lane, also of -0.0."""
        return self.like(1.0)._call("copysign", self)

    def zero_extended(self, kind: Any) -> "Vector":
        """Unsigned integers in a longer type."""
        return Vector(self.builder, self.builder.zext(self.value, self._type_of(kind)))

    def append_sign(self, other: "Vector") -> "Vector":
        """Integers 2 a + (b < 0), in one instruction."""
        vector = self.value.type
        kind = ir.FunctionType(vector, [vector] * 3)
        name = f"llvm.fshl.v{len(self)}i{self.kind.width}"
        move = cgutils.get_or_insert_function(self.builder.module, kind, name)
        arguments = [self.value, other.value, self.like(1).value]
        return Vector(self.builder, self.builder.call(move, arguments))

    def lane(self, k: int) -> Scalar:
        """Value of lane k."""
        return Scalar(self.builder, self.builder.extract_element(self.value, WORD(k)))

    def reduce(self, operation: str) -> Scalar:
        """`minimum`, `maximum` or sum (`__add__`) of all lanes, by halves."""
        values, n = self, len(self)
        while n > 1:
            n //= 2
            halves = [values.lanes(start, n) for start in (0, n)]
            values = getattr(halves[0], operation)(halves[1])
        return values.lane(0)

    def lanes(self, start: int, n: int) -> "Vector":
        """Vector of n lanes from `start` on."""
        return self._picked(range(start, start + n))

    def every(self, step: int, start: int) -> "Vector":
        """Vector of one lane in `step`, from `start` on."""
        return self._picked(range(start, len(self), step))

    def _picked(self, lanes: range) -> "Vector":
        picked = ir.Constant(ir.VectorType(WORD, len(lanes)), list(lanes))
        return Vector(self.builder, self.builder.shuffle_vector(self.value, self.value, picked))

    def bits(self) -> Scalar:
        """Bits of a mask as a 64-bit integer, lane 0 lowest."""
        bits = self.builder.bitcast(self.value, ir.IntType(len(self)))
        return Scalar(self.builder, self.builder.zext(bits, LONG))

    def store(self, pointer: Any) -> None:
        """Write all lanes from an LLVM pointer on."""
        where = self.builder.bitcast(pointer, self.value.type.as_pointer())
        self.builder.store(self.value, where, align=4)


def pack(*masks: Vector) -> Scalar:
    """Bits of masks side by side in a 64-bit integer, those of the first one lowest."""
    packed = masks[0].bits()
    for k, mask in enumerate(masks[1:], 1):
        packed = packed | mask.bits() << k * len(mask)
    return packed


def together(*scalars: Scalar) -> Vector:
    """Vector of scalars of one type."""
    builder, kind = scalars[0].builder, ir.VectorType(scalars[0].kind, len(scalars))
    vector = ir.Constant(kind, ir.Undefined)
    for k, scalar in enumerate(scalars):
        vector = builder.insert_element(vector, scalar.value, WORD(k))
    return Vector(builder, vector)


def joined(*vectors: Vector) -> Vector:
    """Lanes of 2^n vectors of one length, one after the other."""
    parts = list(vectors)
    while len(parts) > 1:
        picked = ir.Constant(ir.VectorType(WORD, 2 * len(parts[0])), list(range(2 * len(parts[0]))))
        parts = [
            Vector(one.builder, one.builder.shuffle_vector(one.value, other.value, picked))
            for one, other in zip(parts[::2], parts[1::2], strict=True)
        ]
    return parts[0]


def load(builder: Any, pointer: Any, n: int) -> Vector:
    """Vector of n lanes from an LLVM pointer on."""
    vector = ir.VectorType(pointer.type.pointee, n)
    return Vector(builder, builder.load(builder.bitcast(pointer, vector.as_pointer()), align=4))


def gather(pointer: Any, index: Vector) -> Vector:
    """Elements of the array at an LLVM pointer, one load a lane."""
    builder = index.builder
    gathered = ir.Constant(ir.VectorType(pointer.type.pointee, len(index)), ir.Undefined)
    for k in range(len(index)):
        value = builder.load(builder.gep(pointer, [index.lane(k).to(LONG).value]))
        gathered = builder.insert_element(gathered, value, WORD(k))
    return Vector(builder, gathered)


def lookup(context: Any, array: Any, n: int, index: Vector) -> Vector:
    """Elements of an array of n words, floats or doubles at `LANES` indices.

    With AVX-512, arrays of at most eight registers are held in them and permuted two registers an
    instruction; elsewhere each lane is loaded.
    """
    builder, kind = index.builder, array.type.pointee
    if kind == SINGLE:  # moved as words
        words = lookup(context, builder.bitcast(array, WORD.as_pointer()), n, index)
        return Vector(builder, builder.bitcast(words.value, ir.VectorType(SINGLE, len(index))))
    width = 512 // (32 if kind == WORD else 64)
    parts = range(0, n, 2 * width)
    if len(parts) > 4 or "+avx512f" not in context.codegen().magic_tuple()[2]:
        return gather(array, index)
    pairs = [
        [load(builder, builder.gep(array, [LONG(at)]), width) for at in (part, part + width)]
        for part in parts
    ]
    found = [
        _permuted(pairs, index.lanes(start, width).to(WORD if kind == WORD else LONG))
        for start in range(0, len(index), width)
    ]
    return joined(*found)


def _permuted(pairs: Sequence[Sequence[Vector]], index: Vector) -> Vector:
    """Elements at these indices of 2^n consecutive pairs of registers."""
    builder, low = index.builder, pairs[0][0]
    name = f"llvm.x86.avx512.vpermi2var.{'d' if low.kind == WORD else 'pd'}.512"
    vector = low.value.type
    kind = ir.FunctionType(vector, [vector, index.value.type, vector])
    permute = cgutils.get_or_insert_function(builder.module, kind, name)
    found = [
        Vector(builder, builder.call(permute, [one.value, index.value, other.value]))
        for one, other in pairs
    ]
    bit = 2 * len(index)
    while len(found) > 1:
        is_odd = (index & bit) > 0
        found = [odd.where(is_odd, even) for even, odd in zip(found[::2], found[1::2], strict=True)]
        bit *= 2
    return found[0]
