"""Warnings about results that are probably mistakes: a wrong unit, inverted faces.

Between a finished network and the commands that print it. Every line is a heuristic, states the
figure that it is based on, and names what to try.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    FloatArray,
    IntArray,
    arccos,
    dots,
    hypot,
    norm,
    plural,
    tan,
)
from rastercov.base.format import coordinates, distance, in_decimals
from rastercov.core.area.stages import first_failures
from rastercov.core.camera import (
    Camera,
    Cameras,
    Poses,
    cameras_of,
    equipment_on,
    eyes_of,
    names_of,
    unit_warnings,
)
from rastercov.core.camera.doubts import convention_warnings
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.task import Reason, Task
from rastercov.core.mesh import Mesh

LEAST_UNSEEN_SHARE = 0.5
"""Share of the area with coverage 0 in every camera above which its sides are looked at."""
LEAST_SHARE_FROM_BEHIND = 0.8
"""Back-facing share of the visible area above which there is a line about normals."""
LEAST_DEAD_SHARE, WIDE = 0.01, math.radians(80)
"""Share of an image without rays above which there is a line; a lens that sees that far from its
axis is a fisheye, whose image may be a disc, and has a line above `MOST_DEAD_SHARE` alone."""
MOST_DEAD_SHARE = 0.9
MAX_BLUR = Camera.max_blur
"""The default of a camera, pixels."""
MOST_BENDING = 1.2
"""Factor by which the scale along the radius may leave what lenses have, from orthographic, cos t,
to rectilinear, 1 / cos^2 t, at an angle t off axis, before there is a line."""
BENDING_STEPS = 257
"""Pixels on each line from the principal point to the border at which it is looked for."""
BEYOND, OUTDOORS = (
    "inside a body, or outside the room",
    "in none of the spaces of the building",
)
MOST_OF_SOLIDS = 100_000
"""Faces up to which cameras are looked for in solids: about 0.3 s."""
BEFORE_FACE = 0.01
"""Distance in front of a face at which a space is, metres."""
MOST_NAMED = 5
"""Cameras that a line names."""
MOST_FACES, MOST_POSES = 2000, 16
"""Faces and cameras whose lines of sight are traced, spread evenly: about 0.1 s."""


def find_warnings(network: Network, camera: Cameras, poses: ArrayLike | Poses) -> list[str]:
    """Lines about the unit of the mesh and the side that its faces show; often none.

    Parameters
    ----------
    network : Network
        The result.
    camera : Camera, or several
        Its depth of field is compared with the size of the mesh.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera of the network.
    """
    placed, cameras = Poses.of(poses), cameras_of(camera)
    if not len(placed):
        return []
    lines = [
        *unit_warnings(network.mesh, camera, placed),
        *_sides(network, cameras, placed[_spread(len(placed), MOST_POSES)]),
        *convention_warnings(network.mesh, cameras, placed),
    ]
    eyes = placed.eyes
    if not lines and network.mesh.n_faces <= MOST_OF_SOLIDS:  # else that is why
        from rastercov.core.mesh.solids import in_solid

        lines += name_places(BEYOND, eyes, in_solid(network.mesh, eyes))
    if network.mesh.spaces:
        lines += _outdoors(network.mesh, eyes)
    for index in np.unique(placed.camera):
        lines += _lens_line(names_of(camera)[index], cameras[index])
        lines += _focus_line(names_of(camera)[index], cameras[index])
    lines += [note for each in equipment_on(camera).values() for note in each.notes]
    blur = network.task.max_blur
    return lines + _without_effect(camera, np.unique(placed.camera).tolist(), blur)


def _without_effect(camera: Cameras, used: Sequence[int], blur: float | None) -> list[str]:
    """Lines on entries of some cameras, by their rows, and `Task.max_blur` that change nothing."""
    names, lines = names_of(camera), list[str]()
    carried = [each.carried_by(names) for each in equipment_on(camera).values()]
    for name, each, index in ((names[row], cameras_of(camera)[row], row) for row in used):
        if each.ir_range is not None and not any(rides[:, index].any() for rides in carried):
            lines.append(
                f"ir_range of {name} is drawn on plan sheets only and changes no coverage: give an "
                "infrared lamp with rig = true and a range"
            )
        is_same = each.depth_of_field(1.0) == each.depth_of_field(2.0)
        if is_same and (blur or each.max_blur != MAX_BLUR):
            lines.append(f"max_blur of {name} has no effect: give f_number and focus_distance")
    return lines


def _focus_line(name: str, camera: Camera) -> list[str]:
    """A line on a camera with a lens of the catalogue that is in focus everywhere."""
    is_known = camera.focus_distance or camera.focus_range or " + " not in (camera.product or "")
    if is_known or camera.focal_length is None:
        return []
    return [f"{name} is assumed to be in focus everywhere: give its focus_distance"]


def _outdoors(mesh: Mesh, eyes: FloatArray) -> list[str]:
    """A line on (P, 3) camera centres in none of the spaces, where the task is in them, metres.

    It is where most of its area, or most of the cameras are.
    """
    from rastercov.core.mesh.solids import rooms_at

    faces = np.flatnonzero(mesh.task_mask)
    faces = faces[_spread(len(faces), MOST_FACES)]
    weights = np.append(mesh.areas[faces], np.ones(len(eyes)))
    points = np.concatenate((mesh.centroids[faces] + BEFORE_FACE * mesh.normals[faces], eyes))
    is_in = np.array([bool(room) for room in rooms_at(mesh, points)])
    halves = np.split(weights * (2.0 * is_in - 1), [len(faces)])
    is_indoors = max(half.sum() for half in halves) > 0
    return name_places(OUTDOORS, eyes, ~is_in[len(faces) :]) if is_indoors else []


def name_places(where: str, eyes: FloatArray, is_there: BoolArray) -> list[str]:
    """A warning about those of (P, 3) camera centres that are somewhere, metres; often none."""
    rows = np.flatnonzero(is_there)
    named = [f"camera {row + 1} at ({coordinates(eyes[row], 1)}) m" for row in rows[:MOST_NAMED]]
    more = ["..."] if len(rows) > MOST_NAMED else []
    line = f"{plural(len(rows), 'camera', 'are')} {where}: {', '.join(named + more)}"
    return [line] if named else []


def dead_pixels(camera: Cameras) -> dict[str, float]:
    """Area of the image without rays, px^2, of each camera that has any, by its name.

    No direction in the valid region of the lens is seen there, see docs/cameras.md.
    """
    cameras = zip(names_of(camera), cameras_of(camera), strict=True)
    return {name: area for name, each in cameras if (area := _dead_area(each)) > 0}


def _dead_area(camera: Camera) -> float:
    if not camera.is_curved:
        return 0.0
    from rastercov.core.camera.lenses.of_camera import blind_area, lens_of

    lens = lens_of(camera)
    return 0.0 if lens.is_whole else blind_area(lens)


def _lens_line(name: str, camera: Camera) -> list[str]:
    """A line on a camera whose lens gives no rays for a part of the image that is no border."""
    share = _dead_area(camera) / (camera.width * camera.height)
    if share <= LEAST_DEAD_SHARE:
        return _bending_line(name, camera)
    from rastercov.core.camera.lenses.of_camera import lens_of

    angle = lens_of(camera).valid_angle
    if angle >= WIDE and share <= MOST_DEAD_SHARE:
        return []
    return [
        f"{100 * share:.0f} % of the image of {name} is outside the valid field of its lens model "
        f"({_off_axis(camera, angle)}): check its model and coefficients"
    ]


def _off_axis(camera: Camera, angle: float) -> str:
    """Place of a ray of a lens in words; `angle` is from the axis, radians."""
    if not camera.is_parallel:
        return f"{in_decimals(math.degrees(angle), 0)} degrees off axis"
    from rastercov.core.camera.lenses.of_camera import unit_of

    return f"{distance(unit_of(camera) * tan(angle))} off axis"


def _bending_line(name: str, camera: Camera) -> list[str]:
    """A line on a lens whose polynomials bend rays more than lenses do, as where none was seen."""
    if not camera.is_curved:
        return []
    from rastercov.core.camera.lenses.of_camera import lens_of
    from rastercov.engine import solver_lens

    lens = lens_of(camera)
    if not any(lens.coefficients[solver_lens.K1 : solver_lens.T00]):
        return []
    x, y = np.meshgrid([0.0, 0.5, 1.0], [0.0, 0.5, 1.0])
    border = np.stack([x * camera.width, y * camera.height], axis=-1).reshape(-1, 2)
    centre, along = np.array([camera.cx, camera.cy]), np.linspace(0, 1, BENDING_STEPS)[1:]
    rays = lens.unproject(centre + along[:, None, None] * (border - centre)).reshape(-1, 3)
    slopes = lens.jacobian(rays)
    rays, slopes = (each[np.isfinite(slopes).all(axis=(1, 2))] for each in (rays, slopes))
    across, cosine = hypot(rays[:, 0], rays[:, 1]), rays[:, 2]
    rays, slopes, cosine = (each[across > 0] for each in (rays, slopes, cosine))
    out = rays[:, :2] / across[across > 0][:, None]
    radial = np.c_[out * cosine[:, None], -across[across > 0]]
    on_axis = dots(lens.jacobian([0.0, 0.0, 1.0])[:, :2], out[:, None])
    scale = norm(dots(slopes, radial[:, None]))
    scale /= norm(on_axis)
    low = np.maximum(cosine, 0)
    high = np.maximum(low, 1e-100) ** -2.0  # of a rectilinear lens; large beyond 90 degrees
    factor = np.maximum(low / scale, scale / high)
    if not len(factor) or not factor.max() > MOST_BENDING:
        return []
    worst = int(factor.argmax())
    place = _off_axis(camera, float(arccos(min(cosine[worst], 1.0))))
    instead = "" if camera.is_parallel else ", or give max_angle_deg"
    return [
        f"the distortion of {name} is implausibly strong at {place} "
        f"(scale {scale[worst]:.2g}, usually {low[worst]:.2g} to {high[worst]:.2g}): calibrate "
        f"there{instead}"
    ]


def _spread(n_rows: int, most: int) -> IntArray:
    """Indices of rows, `most` or fewer, evenly spread."""
    return np.linspace(0, n_rows - 1, min(n_rows, most)).astype(np.int64)


def _sides(network: Network, cameras: Sequence[Camera], poses: Poses) -> list[str]:
    """A warning if most of the surface in view is back-facing.

    The reasons of the faces do not tell it: a closed surface that is inside out is back-facing on
    the near side and occluded on the far one. So the lines of sight to some centroids are traced.
    """
    mesh = network.mesh
    scored = mesh.task_mask & ~mesh.two_sided_mask & ~mesh.degenerate_mask
    area = float(mesh.areas[scored].sum())
    if not area or mesh.areas[scored & (network.best == 0)].sum() < LEAST_UNSEEN_SHARE * area:
        return []
    faces = np.flatnonzero(scored)
    faces = faces[_spread(len(faces), MOST_FACES)]
    points = mesh.centroids[faces]
    areas = np.zeros(2)  # seen from behind, and from the front
    sharp = [each._without_focus() for each in cameras]
    both_sides = mesh.with_groups(two_sided="all")
    failures = first_failures(both_sides, sharp, Task(), poses, points, faces)
    for eye, (reason, _) in zip(eyes_of(cameras, poses), failures, strict=True):
        seen = reason == Reason.COVERED
        to_eye = eye - points[seen]
        is_front = dots(mesh.normals[faces[seen]], to_eye) > 0
        areas += np.bincount(is_front, mesh.areas[faces[seen]], 2)
    share = areas[0] / areas.sum() if areas[0] else 0.0
    if share < LEAST_SHARE_FROM_BEHIND:
        return []
    return [
        f"{100 * share:.0f} % of the surface in view is back-facing: move the cameras "
        "to its front, flip its normals, or declare it two-sided"
    ]
