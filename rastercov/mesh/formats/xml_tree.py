"""XML of mesh files: a tree of elements, its numbers, and its limits.

A document type declaration is an error: no mesh format needs one, and its entities can name other
files or multiply a short text. The test is made by the parser, in whatever encoding the file is.
"""

from collections.abc import Iterable, Sequence
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from rastercov.errors import MeshError
from rastercov.mesh.formats.polygons import check_budget

BYTES_PER_XML_BYTE = 16
"""Memory of the tree: 10 measured with elements of a 3MF vertex, 14 with empty elements."""


def parsed(text: bytes, what: str, budget: int) -> Element:
    """Root element of a text; `what` names it in errors."""
    check_budget(0, budget, n_bytes=len(text) * BYTES_PER_XML_BYTE)
    try:
        has_declaration = _has_declaration(text)
        root = None if has_declaration else ElementTree.fromstring(text)
    # ValueError and LookupError: an encoding that Python does not know.
    except (ElementTree.ParseError, expat.ExpatError, ValueError, LookupError) as error:
        raise MeshError(f"{what} is no XML ({error}); export it again") from None
    if root is None:
        raise MeshError(f"{what} declares a document type, which may hide entities; remove it")
    return root


class _PrologueEndError(Exception):
    """The end of what precedes the root element; `args` has whether a declaration is in it."""


def _has_declaration(text: bytes) -> bool:
    """True for a text with a document type declaration before its root element."""

    def end(has_declaration: bool) -> None:
        raise _PrologueEndError(has_declaration)

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = lambda *_: end(True)
    parser.StartElementHandler = lambda *_: end(False)
    try:
        parser.Parse(text, True)
    except _PrologueEndError as found:
        return bool(found.args[0])
    return False


def local_name(element: Element) -> str:
    """Name without namespace."""
    return element.tag.rpartition("}")[2]


def children(owner: Element, *names: str) -> list[Element]:
    """Children of these names, in any namespace."""
    return [each for each in owner if local_name(each) in names]


def attribute(owner: Element, name: str) -> str | None:
    """Attribute of that name, in any namespace."""
    found = (value for key, value in owner.attrib.items() if key.rpartition("}")[2] == name)
    return next(found, None)


def table(
    elements: Iterable[Element], names: Sequence[str], dtype: type[np.float64] | type[np.int64]
) -> NDArray[Any]:
    """(N, len(names)) numbers in these attributes, of one element a row."""
    words = [element.attrib[name] for element in elements for name in names]
    return np.array(_plain(words), dtype=dtype).reshape(-1, len(names))


def floats(text: str | None) -> NDArray[np.float64]:
    """(N,) numbers of a text, including nan and inf."""
    return np.array(_plain((text or "").split()), dtype=np.float64)


def integers(text: str | None) -> NDArray[np.int64]:
    """(N,) integers of a text."""
    return np.array(_plain((text or "").split()), dtype=np.int64)


def _plain(words: list[str]) -> list[str]:
    """The words; an error for 1_0, which Python reads as ten."""
    for word in words:
        if "_" in word:
            raise MeshError(f"a number wanted, got {word[:40]!r}; correct it")
    return words
