"""Images of cameras: the coverage of what they see in grey, or why they do not cover it.

In a picture of coverage brighter is better, as in the figures of the source. In that of reasons,
covered parts are pale, others have colour and hatch of the criterion that fails, each face as a
whole.

E. S. Eissa. Image Space Coverage Model. 2020, figures 4.2 to 4.6.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from rastercov.camera.camera import Camera
from rastercov.coverage.area.regions import Regions, covering_poses
from rastercov.coverage.job import evaluate
from rastercov.coverage.reasons import NAMES, REASONS, Reason
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.raster import open_rasterizer
from rastercov.report.images import Key, facing, framed, greys, hatched, stripes
from rastercov.report.panorama import FaceImage, Scene, neutral, paint, scene_keys, seen
from rastercov.report.theme import COVERED, REASON_COLOURS, REASON_HATCHES, UNCOVERED, Pixels

FloatArray = NDArray[np.float64]

WHOLE_REL = 1e-6
"""Area, relative, that a face may lack and count as whole here: as covered, or as dead."""


def coverage_picture(
    scene: Scene, values: ArrayLike, title: str = "", named: str = ""
) -> Image.Image:
    """Picture of one pose, brighter where coverage is higher, with its scale below.

    Parameters
    ----------
    scene : Scene
        As `panorama.seen` gives it.
    values : (F,) array_like
        Coverage of each face; beyond [0, 1] it is shown as the nearer end, NaN as 0.
    title : str
        One line above.
    named : str
        Words on level 1, where there is no other.

    Returns
    -------
    PIL.Image.Image
        RGB; the image is at its own size below the title, see `coverage_pixels`.
        Images narrower than `LEAST_WIDTH` are enlarged without smoothing.
    """
    return framed(coverage_pixels(scene, values), title, coverage_keys(scene, named=named))


def coverage_keys(scene: Scene, regions: Regions | None = None, named: str = "") -> list[Key]:
    """Legend of `coverage_picture`, or of `coverage_pixels` with regions."""
    scale = Key.scale("coverage", greys(np.linspace(0, 1, 256)), "0", "1")
    keys = [Key.of(named, greys(1.0)) if named else scale]
    if regions is not None:
        keys = [Key.of_reason("covered"), Key.of("not covered", UNCOVERED)]
    return [*keys, *scene_keys([scene])]


def coverage_pixels(scene: Scene, values: ArrayLike, regions: Regions | None = None) -> Pixels:
    """Pixels of `coverage_picture` without its frame, (H, W, 3).

    The grey of a face is fixed by its coverage except for a head-light of at most 14 %, which keeps
    the form readable: of two faces the one whose coverage is 0.15 higher is brighter in any
    shading. Lines between faces fade out where faces are small.

    With the regions of the pose, a pixel has the colour of its own point, which is covered or not.
    """
    mesh = scene.mesh
    levels = np.clip(np.nan_to_num(np.asarray(values, np.float64)), 0.0, 1.0)
    colours = neutral(mesh, scene.setting)
    colours[mesh.task_mask] = greys(levels[mesh.task_mask])
    if regions is None:
        return paint(scene, colours)
    table = np.array([UNCOVERED, COVERED], np.uint8)
    return paint(scene, colours, lambda face: table[covered_pixels(regions, scene, face) * 1])


def covered_pixels(regions: Regions, scene: Scene, face: FaceImage) -> NDArray[np.bool_]:
    """Pixels of a face image of a scene, (H, W), whose centre is covered by some regions."""
    area = regions.areas().max(axis=0, initial=0.0)
    is_whole = (area > 0) & (area >= (1 - WHOLE_REL) * scene.mesh.areas)
    # Only faces that are covered in part have to be asked point by point.
    partly = np.append((area > 0) & ~is_whole, False)[face]

    def is_covered(faces: NDArray[np.int32], points: FloatArray) -> NDArray[np.bool_]:
        return np.asarray(covering_poses(regions, faces, points).any(axis=1))

    covered: NDArray[np.bool_] = np.append(is_whole, False)[face]
    covered |= scene.at_points(face, is_covered, False, partly)
    return covered


@dataclass(frozen=True, eq=False)
class CameraImage:
    """Image of one camera and the judgement of its faces.

    Attributes
    ----------
    scene : Scene
        What it sees, with nothing beneath.
    hidden : (H, W) bool
        Occluders before a task face that turns its front to the camera.
    reasons : (F,) uint8
        `Reason` of each face.
    faces : int
        Faces that the camera covers.
    """

    scene: Scene
    hidden: NDArray[np.bool_]
    reasons: NDArray[np.uint8]
    faces: int


def camera_image(
    mesh: Mesh, camera: Camera, pose: FloatArray, task: Task, side: int = 720
) -> CameraImage:
    """Image of a camera, at most `side` pixels wide and high, and the judgement of its faces."""
    small = camera.resized(min(1.0, side / max(camera.width, camera.height)))
    with open_rasterizer(mesh, small, "cpu") as rasterizer:
        buffer = rasterizer.render(pose)
    scored = np.flatnonzero(mesh.task_mask & ~mesh.target_mask & facing(mesh, pose)[0])
    scene = seen(mesh, small, pose, buffer, scored)
    reasons = evaluate(mesh, camera, pose[None], task, fields=("coverage", "reason")).reason[0]
    n_covered = int((mesh.task_mask & (reasons == Reason.COVERED)).sum())
    bare = replace(scene, beneath=np.full_like(scene.beneath, -1))
    return CameraImage(bare, (scene.beneath >= 0) & (scene.targets < 0), reasons, n_covered)


def camera_pixels(image: CameraImage) -> Pixels:
    """(H, W, 3) pixels of a camera's image, with what it does not cover in colour and hatch."""
    scene = image.scene
    table, hatch = REASON_COLOURS[image.reasons], REASON_HATCHES[image.reasons]
    pixels = paint(
        scene, neutral(scene.mesh, scene.setting),
        lambda face: hatched(table[face], hatch[face], scene.hatch),
    )  # fmt: skip
    pixels[image.hidden & stripes(scene.face.shape, scene.stripe, 4)] = REASONS["occluded"].colour
    return pixels


def camera_keys(image: CameraImage) -> list[Key]:
    """Legend of a picture of a camera: everything that is in it."""
    scene, drawn = image.scene, np.unique(image.scene.faces)
    judged = drawn[(scene.mesh.task_mask & ~scene.backs)[drawn]]
    shown = np.unique(image.reasons[judged])[::-1].tolist()  # what is covered, first
    keys = [Key.of_reason(NAMES[reason]) for reason in shown]
    keys += scene_keys([scene])
    if image.hidden.any():
        colours = scene.setting.occluder, REASONS["occluded"].colour
        keys.append(Key.of("occluder that hides the task", *colours, 4, 4))
    if (scene.face < 0).any():
        keys.append(Key.of("nothing", scene.setting.background))
    return keys
