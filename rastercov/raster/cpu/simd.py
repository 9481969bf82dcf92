"""Many numbers at once: formulas over short vectors, from which LLVM makes vector code.

numba turns loops into vector code only where they are long and simple. The loops of a rasteriser
are neither, so `loops` writes those of their formulas that matter over `Lanes`,
from which an `@intrinsic` makes LLVM's vectors. They run on every processor: where its vectors are
shorter, LLVM takes several.
"""

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba.core import cgutils

WORD, LONG = ir.IntType(32), ir.IntType(64)
SINGLE, DOUBLE = ir.FloatType(), ir.DoubleType()


class Lanes:
    """One value for each lane, with the operators of its type; a number stands for all lanes."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    @property
    def kind(self) -> Any:
        """Type of one lane."""
        return self.value.type.element

    def __len__(self) -> int:
        return int(self.value.type.count)

    @property
    def _is_float(self) -> bool:
        return self.kind in (SINGLE, DOUBLE)

    def like(self, other: Any) -> "Lanes":
        """A number in all lanes, in the type of these."""
        if isinstance(other, Lanes):
            return other
        number = float(other) if self._is_float else other
        return Lanes(self.builder, ir.Constant(self.value.type, [number] * len(self)))

    def _do(self, other: Any, whole: str, broken: str) -> "Lanes":
        operation = getattr(self.builder, broken if self._is_float else whole)
        return Lanes(self.builder, operation(self.value, self.like(other).value))

    def __add__(self, other: Any) -> "Lanes":
        return self._do(other, "add", "fadd")

    def __sub__(self, other: Any) -> "Lanes":
        return self._do(other, "sub", "fsub")

    def __mul__(self, other: Any) -> "Lanes":
        return self._do(other, "mul", "fmul")

    def __truediv__(self, other: Any) -> "Lanes":
        return self._do(other, "sdiv", "fdiv")

    def __rshift__(self, other: int) -> "Lanes":
        return self._do(other, "ashr", "")

    def __lshift__(self, other: Any) -> "Lanes":
        return self._do(other, "shl", "")

    def __and__(self, other: Any) -> "Lanes":
        return self._do(other, "and_", "")

    def __or__(self, other: Any) -> "Lanes":
        return self._do(other, "or_", "")

    def __invert__(self) -> "Lanes":
        return Lanes(self.builder, self.builder.not_(self.value))

    def _compare(self, sign: str, other: Any) -> "Lanes":
        compare = self.builder.fcmp_ordered if self._is_float else self.builder.icmp_signed
        return Lanes(self.builder, compare(sign, self.value, self.like(other).value))

    def __lt__(self, other: Any) -> "Lanes":
        return self._compare("<", other)

    def __le__(self, other: Any) -> "Lanes":
        return self._compare("<=", other)

    def __gt__(self, other: Any) -> "Lanes":
        return self._compare(">", other)

    def __ge__(self, other: Any) -> "Lanes":
        return self._compare(">=", other)

    def equals(self, other: Any) -> "Lanes":
        """Where both are the same."""
        return self._compare("==", other)

    def where(self, mask: "Lanes", other: Any) -> "Lanes":
        """These values where the mask is set, the other ones elsewhere."""
        return Lanes(
            self.builder, self.builder.select(mask.value, self.value, self.like(other).value)
        )

    def least(self, other: Any) -> "Lanes":
        """The lesser of both."""
        return self.where(self < other, other)

    def greatest(self, other: Any) -> "Lanes":
        """The greater of both."""
        return self.where(self > other, other)

    def to(self, kind: Any) -> "Lanes":
        """The same numbers in another type; to whole numbers by cutting off."""
        if kind == self.kind:
            return self
        vector = ir.VectorType(kind, len(self))
        if not self._is_float and kind in (SINGLE, DOUBLE):
            change = self.builder.sitofp
        elif self._is_float and kind not in (SINGLE, DOUBLE):
            change = self.builder.fptosi
        elif self._is_float:
            change = self.builder.fptrunc if kind == SINGLE else self.builder.fpext
        else:
            change = self.builder.sext if kind == LONG else self.builder.trunc
        return Lanes(self.builder, change(self.value, vector))

    def _call(self, operation: str) -> "Lanes":
        """An operation of LLVM on one vector of numbers."""
        vector = self.value.type
        name = f"llvm.{operation}.v{len(self)}f{32 if self.kind == SINGLE else 64}"
        known = self.builder.module.globals.get(name)
        function = known or ir.Function(
            self.builder.module, ir.FunctionType(vector, [vector]), name
        )
        return Lanes(self.builder, self.builder.call(function, [self.value]))

    def widened(self, kind: Any) -> "Lanes":
        """Whole numbers without a sign in a longer type."""
        vector = ir.VectorType(kind, len(self))
        return Lanes(self.builder, self.builder.zext(self.value, vector))

    def with_sign_of(self, other: "Lanes") -> "Lanes":
        """Whole numbers moved up by a bit, with a lowest bit that is set where others are < 0."""
        vector = self.value.type
        kind = ir.FunctionType(vector, [vector] * 3)
        name = f"llvm.fshl.v{len(self)}i{self.kind.width}"
        move = cgutils.get_or_insert_function(self.builder.module, kind, name)
        arguments = [self.value, other.value, self.like(1).value]
        return Lanes(self.builder, self.builder.call(move, arguments))

    def floor(self) -> "Lanes":
        """Rounded down."""
        return self._call("floor")

    def root(self) -> "Lanes":
        """The square root."""
        return self._call("sqrt")

    def magnitude(self) -> "Lanes":
        """Without the sign."""
        return self._call("fabs")

    def each(self) -> list[Any]:
        """The values of whole numbers, as 64 bits."""
        values = (self.builder.extract_element(self.value, WORD(k)) for k in range(len(self)))
        return [self.builder.sext(value, LONG) for value in values]

    def reduced(self, to: str) -> Any:
        """One value of all lanes: the `least`, the `greatest`, or by `__add__` their sum."""
        values = self
        n = len(self)
        while n > 1:
            n //= 2
            halves = []
            for start in (0, n):
                picked = ir.Constant(ir.VectorType(WORD, n), list(range(start, start + n)))
                half = self.builder.shuffle_vector(values.value, values.value, picked)
                halves.append(Lanes(self.builder, half))
            values = getattr(halves[0], to)(halves[1])
        return self.builder.extract_element(values.value, WORD(0))

    def bits(self) -> Any:
        """A mask as a 64-bit whole number, lane 0 lowest."""
        as_bits = self.builder.bitcast(self.value, ir.IntType(len(self)))
        return self.builder.zext(as_bits, LONG)

    def store(self, pointer: Any) -> None:
        """Write all lanes from a pointer on."""
        where = self.builder.bitcast(pointer, self.value.type.as_pointer())
        self.builder.store(self.value, where, align=4)


def load(builder: Any, pointer: Any, n: int) -> Lanes:
    """Lanes from a pointer on."""
    vector = ir.VectorType(pointer.type.pointee, n)
    return Lanes(builder, builder.load(builder.bitcast(pointer, vector.as_pointer()), align=4))


def spread(builder: Any, value: Any, n: int) -> Lanes:
    """The same value in all lanes."""
    vector = ir.VectorType(value.type, n)
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, WORD(0))
    zeros = ir.Constant(ir.VectorType(WORD, n), [0] * n)
    return Lanes(builder, builder.shuffle_vector(one, one, zeros))


def constants(builder: Any, kind: Any, numbers: Sequence[float]) -> Lanes:
    """Constants, one for each lane."""
    return Lanes(builder, ir.Constant(ir.VectorType(kind, len(numbers)), list(numbers)))


def gather(builder: Any, pointer: Any, indices: Sequence[Any]) -> Lanes:
    """What stands at these indices."""
    gathered = ir.Constant(ir.VectorType(pointer.type.pointee, len(indices)), ir.Undefined)
    for lane, index in enumerate(indices):
        value = builder.load(builder.gep(pointer, [index]))
        gathered = builder.insert_element(gathered, value, WORD(lane))
    return Lanes(builder, gathered)


def from_bits(builder: Any, bits: Any, n: int) -> Lanes:
    """Mask of a 64-bit whole number, lane 0 lowest."""
    as_bits = builder.trunc(bits, ir.IntType(n))
    return Lanes(builder, builder.bitcast(as_bits, ir.VectorType(ir.IntType(1), n)))


def prefetch(builder: Any, pointer: Any, is_written: bool = False) -> None:
    """Ask for the cache line that a pointer points into, before it is needed."""
    octets = ir.IntType(8).as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [octets, WORD, WORD, WORD])
    fetch = builder.module.declare_intrinsic("llvm.prefetch", [octets], kind)
    where = builder.bitcast(pointer, octets)
    builder.call(fetch, [where, WORD(int(is_written)), WORD(3), WORD(1)])


def looked_up(context: Any, array: Any, n: int, index: Lanes) -> Lanes:
    """What stands at sixteen indices of an array of n words or doubles.

    A processor with long registers has up to 64 from these, two at once; others fetch each.
    """
    builder, kind = index.builder, array.type.pointee
    width = 512 // (32 if kind == WORD else 64)
    parts = range(0, n, 2 * width)
    if len(parts) > 4 or "+avx512f" not in context.codegen().magic_tuple()[2]:
        return gather(builder, array, index.each())
    pairs = [
        [load(builder, builder.gep(array, [LONG(at)]), width) for at in (part, part + width)]
        for part in parts
    ]
    found = []
    for start in range(0, len(index), width):
        lanes = ir.Constant(ir.VectorType(WORD, width), list(range(start, start + width)))
        some = Lanes(builder, builder.shuffle_vector(index.value, index.value, lanes))
        some = some.to(WORD if kind == WORD else LONG)
        found.append(_permuted(pairs, some))
    while len(found) > 1:
        lanes = ir.Constant(ir.VectorType(WORD, 16), list(range(16)))
        found = [Lanes(builder, builder.shuffle_vector(found[0].value, found[1].value, lanes))]
    return found[0]


def _permuted(pairs: Sequence[Sequence[Lanes]], index: Lanes) -> Lanes:
    """What stands at these indices of 2^n pairs of registers, one after the other."""
    builder, low = index.builder, pairs[0][0]
    name = f"llvm.x86.avx512.vpermi2var.{'d' if low.kind == WORD else 'pd'}.512"
    vector = low.value.type
    kind = ir.FunctionType(vector, [vector, index.value.type, vector])
    permute = cgutils.get_or_insert_function(builder.module, kind, name)
    found = [
        Lanes(builder, builder.call(permute, [one.value, index.value, other.value]))
        for one, other in pairs
    ]
    bit = 2 * len(index)
    while len(found) > 1:
        is_odd = (index & bit) > 0
        found = [odd.where(is_odd, even) for even, odd in zip(found[::2], found[1::2], strict=True)]
        bit *= 2
    return found[0]
