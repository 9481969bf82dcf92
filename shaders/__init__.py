"""GLSL sources, named `name.stage.glsl`, and the one cached loader that reads them."""

import hashlib
import re
from functools import cache
from importlib.resources import files

from rastercov.base.errors import DeviceError


@cache
def source(name: str, **defines: int) -> str:
    """GLSL text of one stage for the core profile of OpenGL 4.5, with its defines.

    A line `#include "file"` is replaced by that file.

    Parameters
    ----------
    name : str
        File name without `.glsl`, such as `"face.vert"`.
    **defines : int
        Written as `#define NAME value`.

    Raises
    ------
    DeviceError
        When the file is missing from the installation.
    """
    included = re.compile(r'^#include "(.+)"$', re.MULTILINE)
    text = included.sub(lambda line: _read(line[1]), _read(f"{name}.glsl"))
    head = ["#version 450 core"]
    head += [f"#define {key} {value}" for key, value in defines.items()]
    return "\n".join(head) + "\n#line 1\n" + text


def _read(file: str) -> str:
    try:
        return (files(__name__) / file).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise DeviceError(
            f"shader {file} is missing from the installation; reinstall rastercov"
        ) from None


@cache
def digest() -> str:
    """SHA-256 over all shader files, in hexadecimal; every result carries it.

    Those of the viewer's page are left out: no result depends on them.
    """
    total = hashlib.sha256()
    for file in sorted(files(__name__).iterdir(), key=lambda file: file.name):
        if file.name.endswith(".glsl") and not file.name.startswith("viewer_"):
            total.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return total.hexdigest()
