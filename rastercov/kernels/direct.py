"""Calls of compiled loops that do not look at the types of their arguments each time.

Before each call numba looks at every array of every record for its type, to find the loop that was
compiled for it. Of a loop over records with some hundred arrays that takes 20 microseconds, more
than its work on a few faces; the call itself takes one or two.
"""

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
        self._entries: dict[Any, tuple[Any, Any]] = {}

    def __call__(self, loop: Any, *args: Any) -> Any:
        """Call a loop."""
        if loop in self._entries:
            entry, kinds = self._entries[loop]
            if self.is_checked and _kind_of(args) != kinds:
                raise TypeError(f"{loop.__name__} was called with arguments of other types")
            return entry(*args)
        result = loop(*args)
        if hasattr(loop, "get_overload"):  # not where numba is disabled
            import numba

            entry = loop.get_overload(tuple(map(numba.typeof, args)))
            self._entries[loop] = entry, _kind_of(args)
        return result


def _kind_of(value: Any) -> Any:
    """Facts that the type of an argument in compiled loops depends on."""
    if isinstance(value, np.ndarray):
        flags = value.flags
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return value.dtype, value.ndim, layout, flags.writeable, flags.aligned
    if isinstance(value, tuple):
        return type(value), *map(_kind_of, value)
    if isinstance(value, int | float | np.generic):
        return np.asarray(value).dtype
    return type(value), value
