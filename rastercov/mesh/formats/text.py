"""Lines, words and numbers of mesh files in text: OBJ, OFF, ASCII STL and text PLY.

Numbers consist of ASCII digits, a sign, a point, an exponent; Python's "1_0" for ten is refused. A
line is read completely, so an unexpected word is an error and is never skipped.
"""

import io
import re
from array import array
from collections.abc import Container, Iterator, Sequence

from rastercov.base.errors import MeshError, ResourceError

BYTE_ORDER_MARK = b"\xef\xbb\xbf"  # UTF-8; Windows programs write it before the first word
BYTES_PER_CHARACTER = 40  # memory of a line's words: 37 measured with one digit a word
JOINT = b"\v"  # separates words, as spaces do, and marks each place where two lines are joined
FREE_CHARACTERS = 1 << 16  # length of a line that is accepted under any budget
CUT_NOTE = "the file ends inside a line; its last number may be cut, and lines may be missing"


class Lines:
    """Iterator over the lines of a text, split into words; blank lines are left out.

    A line ends with a line feed, a carriage return or both.

    Parameters
    ----------
    data : bytes
    budget : int
        Bytes that the words of one line may take.
    comment : bytes
        Start of a comment; empty if the format has none.
    joins : bool
        True if a backslash at the end of a line continues it.
    number : int
        Number of lines before the text.

    Attributes
    ----------
    number : int
        Number of the latest line; of its last part, if it was continued.
    ends_inside_line : bool
        True if the last line has no line end, or ends with a backslash.
    """

    def __init__(
        self,
        data: bytes,
        budget: int,
        comment: bytes = b"",
        *,
        joins: bool = False,
        number: int = 0,
    ) -> None:
        data = data.removeprefix(BYTE_ORDER_MARK)
        if b"\r" in data:
            data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        # Words like 1_0 are rare, and their test costs time at every number.
        self._has_underscores = b"_" in data
        self.number = number
        self.ends_inside_line = not data.endswith(b"\n")
        last = number + data.count(b"\n") + 1
        self._is_joined = joins and b"\\" in data
        if self._is_joined:
            if comment:
                data = re.sub(re.escape(comment) + rb"[^\n]*", b"", data)
            self.ends_inside_line |= data.removesuffix(b"\n").rstrip(b" \t\f\v").endswith(b"\\")
            data = data.replace(JOINT, b" ").replace(b"\\\n", JOINT)
            data = re.sub(rb"\\[ \t\f]+\n", JOINT, data).removesuffix(b"\\")
        self._cut_line = last if self.ends_inside_line else -1
        self._lines = self._words(
            data, max(budget // BYTES_PER_CHARACTER, FREE_CHARACTERS), comment
        )

    @property
    def is_cut(self) -> bool:
        """True when the file ends inside the latest line."""
        return self.number == self._cut_line

    def _words(self, data: bytes, longest: int, comment: bytes) -> Iterator[list[bytes]]:
        for line in io.BytesIO(data):
            self.number += 1
            if self._is_joined:
                self.number += line.count(JOINT)
            if len(line) > longest:
                raise ResourceError(
                    f"line {self.number}: {len(line)} characters need about "
                    f"{len(line) * BYTES_PER_CHARACTER} bytes, the budget is "
                    f"{longest * BYTES_PER_CHARACTER}; split the line, or raise memory_budget"
                )
            words = (line.partition(comment)[0] if comment else line).split()
            if words:
                yield words

    def __iter__(self) -> Iterator[list[bytes]]:
        return self._lines

    def next(self, wanted: str) -> list[bytes]:
        """Words of the next line; MeshError if there is none."""
        for words in self._lines:
            return words
        raise MeshError(f"{wanted} wanted after line {self.number}, the file ends; it is truncated")

    def take(self, n: int, what: str) -> Iterator[list[bytes]]:
        """Words of the next n lines, one `what` a line; MeshError if there are fewer."""
        i = 0
        while i < n:
            for words in self._lines:
                i += 1
                yield words
                break
            else:
                self.next(f"{what} {i} of {n}")

    def error(self, wanted: str, words: Sequence[bytes]) -> MeshError:
        """Error that names the expected and the actual content of the latest line."""
        text = b" ".join(words[:60])[:60].decode("ascii", "replace")
        return MeshError(f"line {self.number}: {wanted} wanted, got {text!r}; correct the line")

    def floats(self, words: Sequence[bytes], wanted: str) -> list[float]:
        """Numbers, including nan and inf."""
        try:
            if self._has_underscores and b"_" in b"".join(words):
                raise ValueError
            return [float(word) for word in words]
        except ValueError:
            raise self.error(wanted, words) from None

    def integers(self, words: Sequence[bytes], wanted: str) -> list[int]:
        """Integers of 64 bits."""
        try:
            if self._has_underscores and b"_" in b"".join(words):
                raise ValueError
            values = [int(word) for word in words]
            array("q", values)
        except (ValueError, OverflowError):
            raise self.error(wanted, words) from None
        return values

    def point(self, words: Sequence[bytes], n_more: Container[int] = ()) -> list[float]:
        """Three coordinates, optionally followed by `n_more` other numbers."""
        if len(words) == 3:
            return self.floats(words, "three coordinates")
        if len(words) - 3 not in n_more:
            raise self.error("three coordinates", words)
        return self.floats(words, "three coordinates and other numbers")[:3]


def trailing_lines(lines: Lines) -> list[str]:
    """A note if lines are left over."""
    last = lines.number
    return [f"lines after line {last} were not read"] if any(True for _ in lines) else []
