"""Calls of compiled loops that do not look at the types of their arguments each time.

Before each call numba looks at every array of every record for its type, to find the loop that was
compiled for it. Of a loop over records with some hundred arrays that takes 20 microseconds, more
than its work on a few faces; the call itself takes one or two.
"""

from collections.abc import Hashable
from typing import Any

import numpy as np


class DirectCalls:
    """Calls of loops whose arguments always have the same types, from the first call of each on.

    That is: the same records, and arrays of the same dtype, number of dimensions and order in
    memory. An object of one class that keeps its arrays has it, module functions do not.
    """

    is_checked = False
    """True raises a TypeError for arguments of other types, at the cost of looking; for tests."""

    def __init__(self) -> None:
        self._entries: dict[Any, Any] = {}
        self._types: dict[Any, tuple[Any, ...]] = {}

    def __call__(self, loop: Any, *args: Any) -> Any:
        """Call a loop."""
        entry = self._entries.get(loop)
        if entry is not None:
            if self.is_checked and _types_of(args) is not self._types[loop]:
                raise TypeError(f"{loop.__name__} was called with arguments of other types")
            return entry(*args)
        kind = loop, _kind_of(args)
        is_new = kind not in _entry_of
        if is_new:
            result = loop(*args)
            if not hasattr(loop, "get_overload"):  # numba is disabled
                return result
            types = _types_of(args)
            _entry_of[kind] = loop.get_overload(types), types
        self._entries[loop], self._types[loop] = _entry_of[kind]
        return result if is_new else self._entries[loop](*args)


_entry_of: dict[Hashable, tuple[Any, tuple[Any, ...]]] = {}
"""Compiled code, and types of the arguments, of a loop and a kind of arguments."""
_of_kind: dict[Hashable, tuple[Any, ...]] = {}
_same: dict[tuple[Any, ...], tuple[Any, ...]] = {}


def _types_of(args: tuple[Any, ...]) -> tuple[Any, ...]:
    """Types of arguments in compiled loops; the same object for the same types.

    numba is asked once for each kind of arguments: it takes a hundred times as long.
    """
    kind = _kind_of(args)
    types = _of_kind.get(kind)
    if types is None:
        import numba

        types = tuple(map(numba.typeof, args))
        types = _of_kind[kind] = _same.setdefault(types, types)
    return types


def _kind_of(value: Any) -> Hashable:
    """Facts that the type of an argument in compiled loops depends on; few for all calls."""
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.num, type(value)
    if isinstance(value, tuple):
        return type(value), *map(_kind_of, value)
    if isinstance(value, int):
        return type(value), value.bit_length()
    if isinstance(value, float | np.generic):
        return (type(value),)
    return type(value), value
