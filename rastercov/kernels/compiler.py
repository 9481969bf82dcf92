"""numba's compiler for loops in which small functions and named tuples of arrays abound.

It makes the same machine code in half of the time. A first evaluation after installation compiles
five hundred functions, nearly all of them parts of a few loops. What it changes:

- A part has LLVM code only; the loops that call it optimise it and make machine code of it.
- A named tuple is one argument, and its fields and the elements of arrays are read in few
  instructions. numba passes each number of each array of it by itself, and copies the whole of it
  to read a field; LLVM removed that afterwards.
- A function that is `called_whole` stays one: it is not copied into the loops that call it.
- The types of operators are found once, not once for each place in the source.
- Python does not search for garbage meanwhile.
"""

import gc
import operator
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

from llvmlite.binding import Linkage
from numba.core import cgutils, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags
from numba.core.compiler_machinery import register_pass
from numba.core.cpu import CPUContext
from numba.core.datamodel.models import StructModel
from numba.core.datamodel.packer import ArgPacker
from numba.core.datamodel.registry import default_manager
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering
from numba.np.arrayobj import fix_integer_index, load_item, store_item


class _PartLibrary(JITCodeLibrary):
    """LLVM code of a part, for the loops that call it: they optimise it, and make machine code.

    By itself it is only simplified, function by function: to optimise it here, too, took as long as
    to optimise it there.
    """

    def finalize(self) -> None:
        """Add nothing more."""
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """0: there is no machine code."""
        return 0

    @property
    def codegen(self) -> Any:
        """The library itself, as far as numba asks for `set_env`."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Accept the Python objects that a function refers to, of which a part has none."""
        if environment.consts:
            raise ValueError(f"a part of a compiled loop refers to Python objects: {name}")

    def _get_module_for_linking(self) -> Any:
        """LLVM code of the part, and of what it calls."""
        if self._shared_module is None:
            module = self._final_module
            for function in module.functions:
                if not function.is_declaration and function.linkage == Linkage.external:
                    function.linkage = "linkonce_odr"  # dropped once it is inlined
            for library in dict.fromkeys(self._linking_libraries):
                module.link_in(library._get_module_for_linking(), preserve=True)
            self._shared_module = module
        return self._shared_module


_REMEMBERED = frozenset(
    [value for name, value in vars(operator).items() if callable(value) and name[0] != "_"]
    + [abs, bool, len, max, min, range]
)


class _Typing:
    """numba's types of what functions return, remembered for operators.

    numba tries, for each operator in each function, its rules for strings, lists, sets, arrays and
    numbers one after the other; that took a tenth of the time.
    """

    _known: ClassVar[dict[Any, Any]] = {}

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, args: Any, kws: Any) -> Any:
        """Signature of a function for types of arguments."""
        known = getattr(function, "typing_key", None) in _REMEMBERED and not kws
        if not known or not all(map(_is_plain, args)):
            return self._context.resolve_function_type(function, args, kws)
        key = function, args
        if key not in self._known:
            self._known[key] = self._context.resolve_function_type(function, args, kws)
        return self._known[key]

    def resolve_setitem(self, target: Any, index: Any, value: Any) -> Any:
        """Signature of an assignment to an element."""
        if not all(map(_is_plain, (target, index, value))):
            return self._context.resolve_setitem(target, index, value)
        key = target, index, value
        if key not in self._known:
            self._known[key] = self._context.resolve_setitem(*key)
        return self._known[key]


def _is_plain(kind: Any) -> bool:
    """True for numbers, arrays, slices and tuples of them, whose operators have no overloads."""
    if isinstance(kind, types.BaseTuple):
        return all(map(_is_plain, _members(kind)))
    return isinstance(kind, (types.Number, types.Boolean, types.Array, types.SliceType))


def _members(kind: Any) -> tuple[Any, ...]:
    """Types in a tuple; of anything else, itself."""
    is_tuple = isinstance(kind, types.BaseTuple)
    return tuple(kind) if is_tuple else (kind,)


class _RecordModel(StructModel):
    """A named tuple as one argument; numba passes each number of each array by itself."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [(name, kind[k]) for k, name in enumerate(kind.fields)])

    def get_argument_type(self) -> Any:
        return self.get_value_type()

    def as_argument(self, builder: Any, value: Any) -> Any:
        return value

    def from_argument(self, builder: Any, value: Any) -> Any:
        return value


_MODELS = default_manager.copy()
_MODELS.register(types.NamedTuple, _RecordModel)


class _Context(CPUContext):
    """Calls of functions with named tuples."""

    def get_arg_packer(self, kinds: Any) -> Any:
        return ArgPacker(_MODELS, kinds)


class _Lower(Lower):
    """LLVM code of fields, elements and operators, in few instructions.

    numba copies a whole record to read a field, and an array to read an element, and tries each
    operator with constants first. LLVM removes all that; making and removing it took half of the
    time.
    """

    def setup_function(self, description: Any) -> None:
        super().setup_function(description)
        if getattr(self.func_ir.func_id.func, "is_called_whole", False):
            self.function.attributes.add("noinline")

    def lower_expr(self, kind: Any, expression: Any) -> Any:
        if expression.op == "getattr":
            name = expression.value.name
            record = self.typeof(name)
            is_stored = name in self.varmap and name not in self._blk_local_varmap
            if is_stored and isinstance(record, types.NamedTuple):
                k = record.fields.index(expression.attr)
                if record[k] == kind:
                    place = cgutils.gep_inbounds(self.builder, self.getvar(name), 0, k)
                    value = self.builder.load(place)
                    self.incref(kind, value)
                    return value
        return super().lower_expr(kind, expression)

    def lower_binop(self, kind: Any, expression: Any, operation: Any) -> Any:
        signature = self.fndesc.calltypes[expression]
        if operation in (operator.pow, operator.ipow) or not all(map(_is_number, signature.args)):
            return super().lower_binop(kind, expression, operation)
        values = [
            self._cast(value, to)
            for value, to in zip((expression.lhs, expression.rhs), signature.args, strict=True)
        ]
        typing = _Typing(self.context.typing_context)
        function = typing.resolve_value_type(operation)
        found = typing.resolve_function_type(function, signature.args, {})
        value = self.context.get_function(function, found)(self.builder, values)
        return self.context.cast(self.builder, value, signature.return_type, kind)

    def lower_getitem(
        self, kind: Any, expression: Any, array: Any, index: Any, signature: Any
    ) -> Any:
        place = self._element(array, index, signature)
        if place is None:
            return super().lower_getitem(kind, expression, array, index, signature)
        value = load_item(self.context, self.builder, signature.args[0], place)
        return self.context.cast(self.builder, value, signature.return_type, kind)

    def lower_setitem(self, array: Any, index: Any, value: Any, signature: Any) -> Any:
        place = self._element(array, index, signature)
        if place is None:
            return super().lower_setitem(array, index, value, signature)
        kind, given = signature.args[0], signature.args[2]
        content = self.context.cast(self.builder, self._cast(value, given), given, kind.dtype)
        return store_item(self.context, self.builder, kind, content, place)

    def _element(self, array: Any, index: Any, signature: Any) -> Any:
        """Pointer to an element of an array; None for a slice, a row and all else."""
        context, builder = self.context, self.builder
        kind, index_kind = signature.args[:2]
        index_kinds = _members(index_kind)
        if (
            type(kind) is not types.Array
            or not _is_number(kind.dtype)
            or len(index_kinds) != kind.ndim
            or not all(isinstance(one, types.Integer) for one in index_kinds)
        ):
            return None
        whole, model = self.loadvar(array.name), context.data_model_manager[kind]

        def part(name: str) -> Any:
            return builder.extract_value(whole, model.get_field_position(name))

        shape = cgutils.unpack_tuple(builder, part("shape"), kind.ndim)
        strides = ()
        if kind.layout == "A":
            strides = cgutils.unpack_tuple(builder, part("strides"), kind.ndim)
        given = self._cast(index, index_kind)
        is_tuple = isinstance(index_kind, types.BaseTuple)
        indices = cgutils.unpack_tuple(builder, given, kind.ndim) if is_tuple else [given]
        indices = [
            fix_integer_index(context, builder, one, at, size)
            for one, at, size in zip(index_kinds, indices, shape, strict=True)
        ]
        return cgutils.get_item_pointer2(
            context,
            builder,
            part("data"),
            shape,
            strides,
            kind.layout,
            indices,
            boundscheck=context.enable_boundscheck,
        )

    def _cast(self, variable: Any, kind: Any) -> Any:
        value = self.loadvar(variable.name)
        return self.context.cast(self.builder, value, self.typeof(variable.name), kind)


def _is_number(kind: Any) -> bool:
    return isinstance(kind, (types.Number, types.Boolean))


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(NativeLowering):
    _name = "rastercov_lowering"

    @property
    def lowering_class(self) -> Any:
        return _Lower


@contextmanager
def _garbage_kept() -> Iterator[None]:
    """Pause Python's search for garbage, which took a twelfth of the time of a compilation."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class LoopFlags(Flags):
    """Settings of a function that `LoopCompiler` compiles, by which one can tell it."""

    __slots__ = ()


class LoopCompiler(Compiler):
    """numba's compiler of a loop that is called from Python or from other loops."""

    def __init__(self, typing: Any, *options: Any) -> None:
        super().__init__(typing, *options)
        self.state.flags = LoopFlags(self.state.flags)
        self.state.typingctx = _Typing(typing)
        self.state.targetctx.__class__ = _Context

    def _compile_core(self) -> Any:
        with _garbage_kept():
            return super()._compile_core()

    def define_pipelines(self) -> Any:
        """The passes of a part, in order."""
        (pipeline,) = super().define_pipelines()
        pipeline.passes = [
            (_Lowering if step is NativeLowering else step, text) for step, text in pipeline.passes
        ]
        pipeline.finalize()
        return [pipeline]


class PartCompiler(LoopCompiler):
    """The same, up to the LLVM code of a part."""

    def __init__(self, typing: Any, target: Any, library: Any, *options: Any) -> None:
        super().__init__(typing, target, _PartLibrary(target.codegen(), "part"), *options)
