"""Names of a file that its format does not have.

One flipped bit in the name of an optional entry makes a valid file that says less. So a name that
is one slip away from one that matters, and that is missing, is an error; any other is a note.
"""

from collections.abc import Collection
from functools import lru_cache

from rastercov.base.checks import shown
from rastercov.base.errors import RastercovError
from rastercov.base.files import printable

SHORTEST = 3
"""Characters of a name in which a slip is looked for: any two shorter ones are a slip apart."""
MOST_LISTED = 5


class UnknownNames:
    """Unknown names of one file, each with the place where it came first.

    Parameters
    ----------
    error : type
        Error that a slip raises.
    """

    def __init__(self, error: type[RastercovError]) -> None:
        self._error = error
        self._found: dict[str, str] = {}

    def look(
        self,
        where: str,
        names: Collection[str],
        known: frozenset[str],
        harmless: frozenset[str] = frozenset(),
    ) -> None:
        """Look at the names of one table; `harmless` are known ones that nothing depends on."""
        if known.issuperset(names):
            return
        for name in names:
            if name not in known:
                self._add(where, name, names, known - harmless)

    def _add(self, where: str, name: str, names: Collection[str], needed: frozenset[str]) -> None:
        meant = next((other for other in _slips(name, needed) if other not in names), None)
        if meant is not None:
            raise self._error(
                f"{where} has {shown(name)}, which the format does not have, and no {meant!r}; "
                "correct the name"
            )
        self._found.setdefault(name, where)

    def notes(self) -> list[str]:
        """A note with each name once, the first few by name; none without unknown names."""
        words = [
            f"{printable(name, 40)} of {where}"
            for name, where in list(self._found.items())[:MOST_LISTED]
        ]
        n_more = len(self._found) - len(words)
        words += [f"{n_more} others"] if n_more else []
        return [f"not read: {', '.join(words)}; content may be missing"] if words else []


@lru_cache(maxsize=1 << 12)
def _slips(name: str, needed: frozenset[str]) -> tuple[str, ...]:
    return tuple(sorted(other for other in needed if is_slip(name, other)))


def is_slip(name: str, other: str) -> bool:
    """True for two names that differ in one character, two neighbours' order, or upper case."""
    n, m = len(name), len(other)
    if min(n, m) < SHORTEST or abs(n - m) > 1:
        return n == m and name.casefold() == other.casefold()
    start = next(
        (i for i, (a, b) in enumerate(zip(name, other, strict=False)) if a != b), min(n, m)
    )
    if n != m:
        longer, shorter = (name, other) if n > m else (other, name)
        return longer[start + 1 :] == shorter[start:]
    is_turned = name[start : start + 2] == other[start : start + 2][::-1]
    is_turned &= name[start + 2 :] == other[start + 2 :]
    return (
        is_turned or name[start + 1 :] == other[start + 1 :] or name.casefold() == other.casefold()
    )
