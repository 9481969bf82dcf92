"""Many numbers at once: formulas over short vectors, from which LLVM makes vector code.

numba turns loops into vector code only where they are long and simple. The loops of a rasteriser
are neither, so `rastercov.raster.kernels` writes those of their formulas that matter over `Lanes`,
from which an `@intrinsic` makes LLVM's vectors. They run on every processor: where its vectors are
shorter, LLVM takes several.

Loops that are made with it name it to `rastercov.compiled.compiled_with`.
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

    def read_as(self, kind: Any) -> "Lanes":
        """The same bits in another type as long."""
        vector = ir.VectorType(kind, len(self))
        return Lanes(self.builder, self.builder.bitcast(self.value, vector))

    def widened(self, kind: Any) -> "Lanes":
        """Whole numbers without a sign in a longer type."""
        vector = ir.VectorType(kind, len(self))
        return Lanes(self.builder, self.builder.zext(self.value, vector))

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


def _shuffled(builder: Any, one: Any, other: Any, lanes: Sequence[int]) -> Any:
    """Lanes of two vectors, those of the other one counted on from those of the first."""
    picked = ir.Constant(ir.VectorType(WORD, len(lanes)), list(lanes))
    return builder.shuffle_vector(one, other, picked)


def store_rows(columns: Sequence[Lanes], pointer: Any) -> None:
    """Write rows of four, one for each lane, from a pointer on; 8 n of them."""
    builder = columns[0].builder
    for start in range(0, len(columns[0]), 8):
        parts = [
            _shuffled(builder, column.value, column.value, range(start, start + 8))
            for column in columns
        ]
        for odd in (0, 1):
            lanes = [k + odd + at for k in (0, 2, 4, 6) for at in (0, 8)]
            pairs = [_shuffled(builder, parts[k], parts[k + 1], lanes) for k in (0, 2)]
            for upper in (0, 1):
                lanes = [4 * upper + k + i for j in (0, 2) for k in (j, j + 8) for i in (0, 1)]
                rows = _shuffled(builder, *pairs, lanes)
                for half in (0, 1):
                    row = _shuffled(builder, rows, rows, range(4 * half, 4 * half + 4))
                    at = 4 * (start + 4 * upper + 2 * half + odd)
                    Lanes(builder, row).store(builder.gep(pointer, [LONG(at)]))


def gather_rows(builder: Any, pointer: Any, indices: Sequence[Any]) -> list[Lanes]:
    """Four columns of the rows of four that start at these indices, 8 n of them."""
    columns: list[list[Any]] = [[], [], [], []]
    row = ir.VectorType(pointer.type.pointee, 4).as_pointer()
    for start in range(0, len(indices), 8):
        rows = [
            builder.load(builder.bitcast(builder.gep(pointer, [index]), row), align=4)
            for index in indices[start : start + 8]
        ]
        # Rows 0 and 2, 1 and 3, 4 and 6, 5 and 7: what follows then moves whole pairs.
        joined = [_shuffled(builder, rows[k], rows[k + 2], range(8)) for k in (0, 1, 4, 5)]
        for odd in (0, 1):
            lanes = [k + odd + at for k in (0, 2, 4, 6) for at in (0, 8)]
            pairs = [_shuffled(builder, joined[k], joined[k + 1], lanes) for k in (0, 2)]
            for upper in (0, 1):
                lanes = [4 * k + 2 * upper + i for k in range(4) for i in (0, 1)]
                columns[2 * upper + odd].append(_shuffled(builder, *pairs, lanes))
    return [_joined(builder, parts) for parts in columns]


def _joined(builder: Any, parts: Sequence[Any]) -> Lanes:
    """Vectors one after the other, 2^n of them."""
    while len(parts) > 1:
        n = 2 * parts[0].type.count
        parts = [_shuffled(builder, *parts[k : k + 2], range(n)) for k in range(0, len(parts), 2)]
    return Lanes(builder, parts[0])


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


def looked_up(context: Any, builder: Any, array: Any, n: int, index: Lanes) -> Lanes:
    """What stands at sixteen indices of an array of n words: 16, 32, 64 and so on.

    A processor with registers of sixteen words has it from two of them at once; others fetch each.
    """
    if len(index) != 16 or "+avx512f" not in context.codegen().magic_tuple()[2]:
        return gather(builder, array, index.each())
    vector = index.value.type
    kind = ir.FunctionType(vector, [vector] * 3)
    permute = cgutils.get_or_insert_function(
        builder.module, kind, "llvm.x86.avx512.vpermi2var.d.512"
    )
    parts = [load(builder, builder.gep(array, [LONG(at)]), 16).value for at in range(0, n, 16)]
    found = [
        Lanes(
            builder,
            builder.call(permute, [parts[k], index.value, parts[min(k + 1, len(parts) - 1)]]),
        )
        for k in range(0, len(parts), 2)
    ]
    bit = 32
    while len(found) > 1:
        is_odd = (index & bit) > 0
        pairs = zip(found[::2], found[1::2], strict=True)
        found = [odd.where(is_odd, even) for even, odd in pairs]
        bit *= 2
    return found[0]
