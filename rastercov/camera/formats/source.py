"""Content of a file to be recognised and read: its bytes once, and what they parse to."""

from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from rastercov.base.errors import CameraError, MeshError
from rastercov.base.files import (
    LARGEST_ARRAY,
    UnparsedError,
    file_bytes,
    one_line,
    parsed_json,
    read_toml,
)
from rastercov.mesh.formats.xml_tree import parsed

XML_BUDGET = 8 << 30
"""Bytes of memory that a tree of XML may need."""
LARGEST_YAML = 16 << 20
"""Bytes: 20 s of parsing where PyYAML has no compiled parser."""


class Source:
    """A file, read when it is asked for."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @cached_property
    def data(self) -> bytes:
        """Its bytes."""
        return file_bytes(self.path, LARGEST_ARRAY)

    @cached_property
    def is_xml(self) -> bool:
        """True for text that begins with "<", in UTF-8 or UTF-16."""
        start = self.data[:4000]
        marks = (b"\xff\xfe<\0", b"\xfe\xff\0<")
        return start.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<") or start[:4] in marks

    @cached_property
    def text(self) -> str:
        """Its text."""
        try:
            return self.data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise UnparsedError("text", f"{one_line(error)}; save it as UTF-8") from None

    @cached_property
    def json(self) -> Any:
        """Content of JSON; a name that comes twice in a table is an error."""
        return parsed_json(self.data)

    @cached_property
    def toml(self) -> dict[str, Any]:
        """Table of TOML."""
        return read_toml(self.path)

    @cached_property
    def yaml(self) -> Any:
        """Content of YAML."""
        if len(self.data) > LARGEST_YAML:
            raise CameraError(
                f"at most {LARGEST_YAML} bytes of YAML wanted, got {len(self.data)}; leave out "
                "what is no camera"
            )
        from rastercov.camera.formats.yaml_tree import parsed_yaml  # loads PyYAML

        return parsed_yaml(self.text)

    @cached_property
    def xml(self) -> Element:
        """Root element of XML."""
        try:
            return parsed(self.data, "it", XML_BUDGET)
        except MeshError as error:
            raise CameraError(str(error)) from None
