"""Image of one camera of a viewer, with what it covers, hides and cannot resolve, as PNG."""

from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rastercov.base.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.report import theme
from rastercov.report.camera_pictures import camera_image, camera_keys, camera_pixels
from rastercov.viewer.measurements import of_one_camera
from rastercov.viewer.rig_state import RigState

LEAST_SIDE, MOST_SIDE = 64, 2048


def camera_png(
    mesh: Mesh, state: RigState, station: int, side: int
) -> tuple[dict[str, Any], bytes]:
    """The camera's own image, its distortion included: title, size and legend, and a PNG.

    Parameters
    ----------
    station : int
        Id of the station.
    side : int
        Longest side, px; at most that of the camera.

    Raises
    ------
    ConfigError
        For a station that is gone, or a side outside its limits.
    """
    if not LEAST_SIDE <= side <= MOST_SIDE:
        raise ConfigError(f"side must be {LEAST_SIDE} to {MOST_SIDE} px, got {side}")
    row = state.row(station)
    own = state.stations[row]
    camera, task = state.camera_of(own), of_one_camera(state.task)
    red, green, blue = theme.camera_colours(row + 1)[row].tolist()
    colour = (red, green, blue)
    found = camera_image(mesh, camera, own.pose, task, side=side)
    pixels = camera_pixels(found, colour)
    legend = [
        {
            "label": key.name,
            "colour": swatch[0, 0].tolist(),
            "stripe": _stripe(swatch),
        }
        for key in camera_keys([found], colour, "covered")
        for swatch in (np.asarray(key.image),)
    ]
    buffer = BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", compress_level=1)
    height, width = pixels.shape[:2]
    title = f"{own.name}: covers {found.faces:,} whole faces"
    return {"width": width, "height": height, "title": title, "legend": legend}, buffer.getvalue()


def _stripe(swatch: NDArray[np.uint8]) -> list[int] | None:
    """The second colour of a swatch; None where it has one."""
    colours = np.unique(swatch.reshape(-1, 3), axis=0)
    others = [each for each in colours.tolist() if each != swatch[0, 0].tolist()]
    return others[0] if others else None
