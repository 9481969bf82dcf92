"""Sections of a plan file on cameras: the one camera, types of cameras with costs, and rigs."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, ValidationInfo, model_validator

from rastercov.base.errors import CameraError, RastercovError
from rastercov.camera.camera import Camera
from rastercov.camera.camera_file import PRESETS, check_optics
from rastercov.camera.formats import read_views
from rastercov.camera.formats.conventions import Conventions
from rastercov.camera.rig import Rig
from rastercov.mesh.arrays import rotation_about
from rastercov.placement.plan.entry import (
    Count,
    Direction,
    Entry,
    File,
    Name,
    NotNegative,
    Number,
    Pair,
    Triple,
    among,
    fields_of,
    only_one,
)

OF_FILES = ("pixel_centre", "lens_model", "image_size")
"""Entries that answer what a camera file leaves open."""
Preset = Annotated[
    str, AfterValidator(among(PRESETS)), Field(json_schema_extra={"enum": list(PRESETS)})
]

# Ignored types below: mypy does not follow the classes that `fields_of` makes.


OF_A_LIST = ("pixel_size", "focus_range", "distortion")
"""Entries of a camera that are arrays in a file, and tuples in a `Camera`."""


class CameraSection(fields_of(Camera, is_optional=True, leave_out=OF_A_LIST)):  # type: ignore[misc]
    """The camera: a preset, a file, or the entries of a camera file, which also change a preset."""

    file: File | None = Field(
        default=None,
        description="Camera file, ours (.toml, .json) or of another program; with the entries that "
        "answer what it leaves open, and the optics that it lacks: f_number, focus_distance, ...",
    )
    name: str | None = Field(default=None, description="Camera of a file with several.")
    pixel_centre: float | None = Field(
        default=None, description="Coordinate of the first pixel's centre in the file: 0 or 0.5."
    )
    lens_model: Literal["brown", "fisheye"] | None = Field(
        default=None, description="Model of four coefficients in the file."
    )
    image_size: list[Count] | None = Field(
        default=None, description="[width, height], px, for a file without."
    )
    preset: Preset | None = Field(
        default=None, description="Camera of the thesis; other entries change it."
    )
    pixel_size: Number | list[Number] | None = Field(
        default=None, description="Metres, one or two."
    )
    principal_point: Pair | None = Field(
        default=None, description="Metres from the top-left corner."
    )
    f_number: Number | None = Field(
        default=None, description="f/N; with focus_distance, and pixel_size beside fx and fy."
    )
    hfov_deg: Number | None = Field(
        default=None, description="Angle between left and right, deg; instead of fx."
    )
    vfov_deg: Number | None = Field(
        default=None, description="Angle between top and bottom, deg; instead of fy."
    )
    focus_range: list[float] | None = Field(
        default=None, description="[near, far] depths in focus, m; instead of an aperture."
    )
    distortion: list[float] | None = Field(
        default=None, description="Coefficients of the model, in its order."
    )

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Self:
        self.build(Path((info.context or {}).get("folder", ".")))
        return self

    def build(self, folder: Path) -> Camera:
        """The camera; CameraError where the entries do not make one."""
        entries = self.model_dump(exclude_none=True, exclude={"cost"})
        if self.file is None:
            return Camera.from_dict(entries)
        optics = {k: v for k, v in entries.items() if k not in ("file", "name", *OF_FILES)}
        check_optics(optics)
        try:
            given = {name: entries[name] for name in OF_FILES if name in entries}
            conventions = Conventions(**given)
            views = read_views(folder / self.file, conventions=conventions)
            return views.camera(self.name).with_optics(optics)
        except RastercovError as error:
            text = str(error).replace("--camera-name", "name")
            for name in OF_FILES:
                text = text.replace(f"--{name.replace('_', '-')}", f"{name} =")
            raise CameraError(text.replace("= WIDTHxHEIGHT", "= [width, height]")) from None


ONE_CAMERA = "camera"
"""Name of the camera of a plan with one."""


class CameraType(CameraSection):
    """One of several types of cameras, by its name."""

    cost: NotNegative | None = Field(
        default=None, description="Of one of them, added to that of its place; 1 unless given."
    )


class RigCamera(Entry):
    """Place of a camera on a rig: turned about an axis through the origin of the rig, then moved.

    Axes of rig and camera: x right, y down, z forward.
    """

    camera: Name = Field(description="Name of the camera.")
    name: Name | None = Field(
        default=None, description="Its name on the rig; that of the camera unless given."
    )
    axis: Direction = Field(default=[0.0, 1.0, 0.0], description="Of the turn, in the rig's axes.")
    angle_deg: Number = Field(default=0.0, description="Of the turn, degrees.")
    translation: Triple = Field(default=[0.0, 0.0, 0.0], description="Metres, after the turn.")

    def rig_from_camera(self) -> NDArray[np.float64]:
        """(4, 4) place on the rig."""
        place = np.eye(4)
        place[:3, :3] = rotation_about(self.axis, math.radians(self.angle_deg))
        place[:3, 3] = self.translation
        return place


class RigSection(Entry):
    """Cameras that move together: of the plan, or all of a file with their places."""

    cameras: Annotated[list[RigCamera], Field(min_length=1)] | None = Field(
        default=None, description="Cameras of the plan and their places."
    )
    file: File | None = Field(
        default=None, description="File of cameras with their places, such as a Kalibr camchain."
    )
    cost: NotNegative | None = Field(
        default=None, description="Of the rig; that of its cameras together unless given."
    )

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Self:
        only_one(self, ("cameras", "file"))
        if self.file is not None:
            self.build(Path((info.context or {}).get("folder", ".")), {})
        return self

    def build(self, folder: Path, cameras: Mapping[str, Camera]) -> Rig:
        """The rig of the cameras of a plan, or of its file; CameraError where there is none."""
        if self.file is not None:
            views = read_views(folder / self.file)
            if views.rig is None or not views.has_unit:
                lacks = "cameras" if views.rig is None else "a unit of their places"
                raise CameraError(f"{self.file} is without {lacks}; convert it, with its unit")
            return views.rig
        own = self.cameras or []
        names = [each.name or each.camera for each in own]
        places = [each.rig_from_camera() for each in own]
        return Rig([cameras[each.camera] for each in own], names, places)
