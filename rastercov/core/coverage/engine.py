"""Choice of the engine that measures visibility: method, device, samples and threads.

The text form is METHOD[:DEVICE][@S], such as `certified`, `sampled:cpu` or `sampled:egl:0@4`. It is
accepted wherever `method` is, in Python and on the command line.
"""

import re
from dataclasses import dataclass, replace
from typing import Self

from rastercov.base import (
    ByName,
    ConfigError,
    check_choice,
    check_kind,
    finite_number,
    shown,
    thread_count,
)
from rastercov.base.typed import typed
from rastercov.core.raster import BACKENDS
from rastercov.core.raster.contract import MAX_SUPERSAMPLE

METHODS = ("certified", "exact", "sampled")


@dataclass(frozen=True)
class Engine:
    """Method of visibility and the device that computes it.

    Parameters
    ----------
    method : {"certified", "exact", "sampled"}
        Method, see `rastercov.open_observer`.
    device : str
        Device for method "sampled" and for pictures: "auto", "cpu", "gl", "hardware" (a GPU),
        or the name of an OpenGL device (`rastercov doctor` lists them).
    supersample : int
        S, for method "sampled": S x S samples per pixel, from 1 to 64.
    threads : int, optional
        Number of threads on the CPU; one per core unless given.

    Raises
    ------
    ConfigError
        For an unknown method, or supersampling with a method that does not sample.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), distance=0.6, count=6)
    >>> sampled = rc.Engine("sampled", device="cpu", supersample=2)
    >>> result = rc.evaluate(mesh, camera, poses, method=sampled)
    >>> result.by, result.engine.supersample
    ('face', 2)
    """

    method: str = "certified"
    device: str = "auto"
    supersample: int = 1
    threads: int | None = None

    def __post_init__(self) -> None:
        check_choice("method", self.method, METHODS)
        check_kind("device", self.device, str, "a string", ConfigError)
        scale = finite_number(self.supersample)
        if self.method != "sampled" and scale != 1:
            raise ConfigError(
                f"expected supersample 1 with method {self.method}, got {shown(self.supersample)}; "
                "use method sampled"
            )
        if scale not in range(1, MAX_SUPERSAMPLE + 1):
            raise ConfigError(
                f"expected supersample from 1 to {MAX_SUPERSAMPLE}, got {shown(self.supersample)}; "
                "give a whole number"
            )
        object.__setattr__(self, "supersample", int(scale))
        if self.threads is not None:
            object.__setattr__(self, "threads", thread_count(self.threads))

    @classmethod
    @typed
    def parse(cls, text: str) -> Self:
        """Engine from text of the form METHOD[:DEVICE][@S], such as "sampled:egl:0@4".

        Raises
        ------
        ConfigError
            For another form, an unknown method, or supersampling with a method that does not
            sample.
        """
        form = re.fullmatch(r"(\w*)(?::([^@]+))?(?:@([0-9]{1,9}))?", text, re.ASCII)
        if form is None:
            raise ConfigError(
                f"expected a method such as sampled:cpu@4, got {shown(text)}; correct it"
            )
        method, device, scale = form.groups()
        return cls(method, device or "auto", int(scale or 1))

    @classmethod
    def of(cls, method: "str | Engine", threads: int | None = None) -> "Engine":
        """Engine from an `Engine`, a method, or the text form, with `threads` if given."""
        if isinstance(method, Engine):
            engine = method
        elif isinstance(method, str) and (":" in method or "@" in method):
            engine = cls.parse(method)
        else:
            engine = cls(method)
        return engine if threads is None else replace(engine, threads=threads)

    def __str__(self) -> str:
        device = f":{self.device}" if self.device != "auto" else ""
        return self.method + device + (f"@{self.supersample}" if self.supersample > 1 else "")

    @property
    def rasterizer_options(self) -> ByName:
        """Keyword arguments of `open_rasterizer` for the device, and the threads of the CPU."""
        if self.device not in BACKENDS:
            return {"backend": "gl", "device": self.device}
        has_threads = self.threads is not None and self.device != "gl"
        return {"backend": self.device} | ({"threads": self.threads} if has_threads else {})
