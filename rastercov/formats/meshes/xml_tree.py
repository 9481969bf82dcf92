"""XML of mesh files: a tree of elements, its numbers, and its limits.

A document type declaration is an error: no mesh format needs one, and its entities can name other
files or multiply a short text. The text is decoded first, so that no encoding hides one.
"""

import codecs
import re
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from rastercov.base import AnyArray, FloatArray, IntArray, UnknownNames, Vocabulary
from rastercov.formats.meshes.polygons import broken, check_budget

BYTES_PER_XML_BYTE = 12
"""Memory of a tree: 7.8 measured with vertices of a 3MF, 10.6 with triangles; see `_need`."""
ENCODINGS = ("utf", "ascii", "iso8859", "cp125", "gb", "big5", "shift_jis", "euc")
"""Beginnings of the names of encodings that are read; some others take quadratic time."""
DECLARED_ENCODING = re.compile(rb"""<\?xml[^>]{1,200}?encoding\s*=\s*["']([\w.-]{1,40})["']""")
DECLARATION = re.compile(rb"(?:\xef\xbb\xbf)?(?>\s+|<\?.*?\?>|<!--.*?-->)*+<!DOCTYPE", re.DOTALL)
"""A document type declaration before the root element."""
IS_HTML = re.compile(DECLARATION.pattern + rb"\s+html", re.DOTALL | re.IGNORECASE)
UTF_16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
LONG_NAMESPACE = re.compile(
    rb"""xmlns(?:[^=<>]{200}|[^=<>]{0,199}=(?:\s{200}|\s{0,199}(?:"[^"]{256}|'[^']{256})))"""
)
"""A namespace of 256 characters or more, or spaces that might hide one."""


def parse_xml(text: bytes, what: str, budget: int) -> Element:
    """Root element of a text; `what` names it in errors."""
    check_budget(0, budget, n_bytes=len(text) * BYTES_PER_XML_BYTE)
    root = None
    try:
        text = _utf_8(text)
        check_budget(0, budget, n_bytes=_need(text))
        # The parser writes the namespace before the name of every element.
        if LONG_NAMESPACE.search(text):
            raise ValueError("a namespace of more than 255 characters")
        if not DECLARATION.match(text):
            root = _tree(text)
    # ValueError and LookupError: an encoding that is not known, or not kept to.
    except (ElementTree.ParseError, expat.ExpatError, ValueError, LookupError) as error:
        raise broken(f"expected {what} to be XML, got: {error}") from None
    if root is None:
        if IS_HTML.match(text):
            raise broken(f"expected {what} to be XML, got an HTML page", "give another file")
        raise broken(f"expected {what} without a document type, got one", "remove it")
    return root


def _tree(text: bytes) -> Element:
    """Root element; a prefix that nothing declares is its own namespace."""
    try:
        return ElementTree.fromstring(text, ElementTree.XMLParser(encoding="utf-8"))
    except ElementTree.ParseError as error:
        if expat.ErrorString(error.code) != expat.errors.XML_ERROR_UNBOUND_PREFIX:
            raise
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate("utf-8")

    def name_of(name: str) -> str:
        prefix, _, own = name.rpartition(":")
        return f"{{{prefix}}}{own}" if prefix else own

    def start(name: str, given: dict[str, str]) -> None:
        own = {name_of(key): value for key, value in given.items() if not key.startswith("xmlns")}
        builder.start(name_of(name), own)

    parser.StartElementHandler, parser.CharacterDataHandler = start, builder.data
    parser.EndElementHandler = lambda name: builder.end(name_of(name))
    parser.Parse(text, True)
    return builder.close()


def namespaces(text: bytes) -> dict[str, str]:
    """Namespaces by their prefixes that the root element of a text, already parsed, declares."""
    texts: dict[str, str] = {}
    parser = expat.ParserCreate("utf-8")

    def start(name: str, given: dict[str, str]) -> None:
        parser.StartElementHandler = None
        prefix = "xmlns:"
        texts.update((k[len(prefix) :], v) for k, v in given.items() if k.startswith(prefix))

    parser.StartElementHandler = start
    parser.Parse(_utf_8(text), True)
    return texts


def _utf_8(text: bytes) -> bytes:
    """The text in UTF-8, whatever encoding it declares."""
    declared = DECLARED_ENCODING.match(text.removeprefix(codecs.BOM_UTF8)[:300])
    encoding = declared[1].decode() if declared else "utf-8"
    if text.startswith(UTF_16_MARKS):
        encoding = "utf-16"
    name = codecs.lookup(encoding).name
    if name in ("utf-8", "ascii"):
        return text
    if not name.startswith(ENCODINGS):
        raise LookupError(f"encoding {encoding}, which is not supported")
    return text.decode(name).encode()


def _need(text: bytes) -> int:
    """Bytes that the tree of a text may take, by its tags and attributes.

    Measured a byte of the text: 18 for empty elements, 36 for elements of one attribute each.
    """
    n_tags, n_attributes = text.count(b"<"), text.count(b"=")
    elements = 120 * n_tags + 250 * min(n_tags, n_attributes) + 100 * n_attributes
    return max(elements, BYTES_PER_XML_BYTE * len(text))


def local_name(element: Element) -> str:
    """Name without namespace."""
    return element.tag.rpartition("}")[2]


def children(owner: Element, *names: str) -> list[Element]:
    """Children of these names, in any namespace."""
    return [each for each in owner if local_name(each) in names]


def below(owner: Element, *path: str) -> list[Element]:
    """Elements at the end of a path of names, in any namespace: children, theirs, and so on."""
    items = [owner]
    for name in path:
        items = [each for parent in items for each in children(parent, name)]
    return items


def look_at_names(root: Element, names: Vocabulary, unknown_names: UnknownNames) -> None:
    """Look at the names of attributes and children of the elements of a vocabulary, once each.

    Words between elements are a child "text".
    """
    stack = [(root, "the file")]
    while stack:
        owner, where = stack.pop()
        where = next((repr(each[:40]) for key in ("name", "id") if (each := owner.get(key))), where)
        tags = {tag: tag.rpartition("}")[2] for tag in {each.tag for each in owner}}
        own = {*tags.values(), *(key.rpartition("}")[2] for key in owner.attrib)}
        if any(text and not text.isspace() for text in (owner.text, *(e.tail for e in owner))):
            own.add("text")
        unknown_names.look(where, own, names.known, names.harmless)
        if inner := {tag for tag, name in tags.items() if name in names.inner}:
            stack += [(each, where) for each in reversed(owner) if each.tag in inner]


def attribute(owner: Element, name: str) -> str | None:
    """Attribute of that name, in any namespace."""
    items = (value for key, value in owner.attrib.items() if key.rpartition("}")[2] == name)
    return next(items, None)


def table(
    elements: Iterable[Element], names: Sequence[str], dtype: type[np.float64] | type[np.int64]
) -> AnyArray:
    """(N, len(names)) numbers in these attributes, of one element a row."""
    words = [element.attrib[name] for element in elements for name in names]
    return _numbers(words, dtype).reshape(-1, len(names))


def floats(text: str | None) -> FloatArray:
    """(N,) numbers of a text, including nan and inf."""
    return _numbers((text or "").split(), np.float64)


def transform_numbers(text: str | None, count: int) -> FloatArray:
    """Numbers of a transform, finite and that many, or MeshError."""
    values = floats(text)
    if values.shape != (count,) or not np.isfinite(values).all():
        shown = repr((text or "").strip()[:60])
        raise broken(f"expected a transform of {count} finite numbers, got {shown}")
    return values


def integers(text: str | None) -> IntArray:
    """(N,) integers of a text."""
    return _numbers((text or "").split(), np.int64)


def _numbers(words: list[str], dtype: type[np.float64] | type[np.int64]) -> AnyArray:
    """Numbers of words; an error that names a wrong one, such as 1_0, which Python reads as ten."""
    kind = float if dtype is np.float64 else int

    def is_number(word: str) -> bool:
        try:
            np.array(kind(word.replace("_", "?")), dtype)
        except (ValueError, OverflowError):
            return False
        return True

    try:
        if not any("_" in word for word in words):
            return np.array(words, dtype)
    except (ValueError, OverflowError):
        pass
    wrong = next((word for word in words if not is_number(word)), "others")
    advice = "write decimals with a point" if "," in wrong else "export it again"
    wanted = "a number" if kind is float else "a whole number of 64 bits"
    raise broken(f"expected {wanted}, got {wrong[:40]!r}", advice)
