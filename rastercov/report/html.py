"""HTML pages of reports by jinja2, with all pictures inline.

A page needs nothing else: no script, no request. It follows the light or dark theme of its reader
and fits a phone and a desk. Text is escaped by default. jinja2 is imported with the first page.
"""

import base64
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from PIL import Image

from rastercov.base.format import length, number, percent, plural
from rastercov.report.images import png
from rastercov.report.theme import DARK, LIGHT

if TYPE_CHECKING:
    from jinja2 import Environment


@dataclass(frozen=True)
class Picture:
    """An image of a page as PNG, its description, and its twin for the dark theme."""

    alt: str
    light: bytes
    dark: bytes | None = None

    @classmethod
    def of(cls, alt: str, image: Image.Image) -> "Picture":
        """A drawing in 255 colours, with its small areas of a colour of their own."""
        return cls(alt, png(image, Image.Quantize.FASTOCTREE))


def rendered(template: str, package: str = "rastercov.report", **values: Any) -> str:
    """HTML of a template in the folder `templates` of a package, with some values."""
    return _environment(package).get_template(template).render(values)


@cache
def _environment(package: str) -> "Environment":
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    environment = Environment(
        autoescape=True,
        keep_trailing_newline=True,
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("rastercov.report")]),
        lstrip_blocks=True,
        trim_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= {
        "count": "{:,}".format,
        "metres": length,
        "number": number,
        "percent": percent,
        "plural": plural,
        "uri": _uri,
    }
    environment.globals |= {"light": LIGHT, "dark": DARK}
    return environment


def _uri(data: bytes) -> str:
    """Address of a PNG that is in the page itself."""
    return "data:image/png;base64," + base64.b64encode(data).decode("ascii")
