"""Attack on edge-on faces: cameras at the heights and in the planes of faces, and needles.

Boxes and needles whose corners are round numbers, or rotated, or far from the origin; eyes in the
planes of faces, at vertices and on edges, or beside them by 1e-16 to 1e-9. Every figure of
`certified` and `exact` is compared with exact rational arithmetic, by image and by area: a face
whose plane has the eye in it exactly, or that turns its back by less than rounding, has neither
area nor bound; what is in doubt adds to the upper end alone. Of faces that coincide to 1e-10 of
their depth the index decides, or the depth: either is right in an image.
"""

from dataclasses import dataclass

import numpy as np
from attack_exact import is_partial, random_camera
from exact_cases import box
from exact_views import exact_sides
from rows import Report
from scenes import joined

import rastercov as rc
from rastercov.core.raster.contract import BoundKind
from rastercov.reference import rational

SCENES, VIEWS = 1_500, 6
ROUNDING, OF_FRAME = 1e-9, 1e-15
"""Of an area on the surface, relative to that of the face; and of the frame of a face, relative to
the square of the greatest coordinate: needles may be no wider."""


@dataclass
class Score:
    """Figures compared, and those that were wrong."""

    image: int = 0
    image_wrong: int = 0
    area: int = 0
    area_wrong: int = 0
    edge_on: int = 0
    doubtful: int = 0
    worst: float = 0.0
    """Largest error in the image as a part of its bound."""


def attack(report: Report, effort: float) -> None:
    """Add the rows of this campaign; `effort` 1 is 1,500 scenes of 6 views by two methods."""
    score = Score()
    for seed in range(max(10, round(SCENES * effort))):
        compare(seed, score)
    report.add("edge-on: figures of images compared with fractions", score.image, "figures")
    report.add("edge-on: figures by area compared with fractions", score.area, "figures")
    report.add("edge-on: faces that an eye is in the plane of, exactly", score.edge_on, "faces")
    report.add("edge-on: faces in doubt", score.doubtful, "faces")
    report.add("edge-on: largest error as a part of its bound", score.worst, "", at_most=1.0)
    report.check("edge-on: no bound of an image is exceeded", score.image_wrong == 0)
    report.check("edge-on: no bound of an area is exceeded", score.area_wrong == 0)


def compare(seed: int, score: Score) -> list[str]:
    """Compare both methods with fractions on one scene; a line for each figure that is wrong."""
    rng = np.random.default_rng(seed)
    mesh = scene(rng)
    camera = random_camera(rng)
    poses = np.array([pose_in_plane(mesh, rng) for _ in range(VIEWS)])
    truths = [
        (
            *visible_areas(mesh, camera, pose),
            np.asarray(rational.image_area(mesh, camera, pose)),
            exact_sides(mesh, pose),
        )
        for pose in poses
    ]
    lines = []
    for method in ("certified", "exact"):
        with rc.open_observer(mesh, camera, method, threads=1) as observer:
            seen = observer.observe(poses)
        regions = rc.regions(mesh, camera, poses, method=method, threads=1)
        areas, bounds = regions.areas(), regions.bounds()
        excess = np.zeros_like(bounds)
        excess[regions.pair_pose, regions.pair_face] = regions.excess
        for row, (by_index, by_depth, image, side) in enumerate(truths):
            own = seen.visible_pixels[row]
            is_by_depth = np.abs(own - by_depth) < np.abs(own - by_index)
            visible = np.where(is_by_depth, by_depth, by_index)
            off = np.abs(own - visible) + np.abs(seen.drawn_pixels[row] - image)
            bound = seen.area_error[row]
            # Culled: faces that cannot be seen are not drawn either.
            is_culled = (seen.drawn_pixels[row] == 0) & (visible == 0)
            wrong = (off > bound) & ~is_culled
            certified = seen.kind[row] == BoundKind.CERTIFIED
            wrong |= certified & is_partial(seen.visible_pixels[row], visible, image)
            wrong |= (side == 0) & ((seen.drawn_pixels[row] > 0) | (bound > 0))
            is_bounded = ~is_culled & (bound > 0)
            share = off[is_bounded] / bound[is_bounded]
            score.worst = max(score.worst, float(share.max(initial=0)))
            score.image += mesh.n_faces
            score.image_wrong += int(wrong.sum())
            lines += [
                f"seed {seed} view {row} face {f} {method}: off {off[f]:.3g} bound {bound[f]:.3g} "
                f"side {side[f]} certified {certified[f]} of {visible[f]:.3g} {image[f]:.3g} px^2"
                for f in np.flatnonzero(wrong)
            ]
            wrong = wrong_areas(
                mesh, camera, poses[row], (visible, image, side),
                (areas[row], bounds[row], excess[row]),
            )  # fmt: skip
            score.area += mesh.n_faces
            score.area_wrong += int(wrong.sum())
            score.edge_on += int((side == 0).sum())
            score.doubtful += int((bounds[row] > excess[row]).sum())
            lines += [
                f"seed {seed} view {row} face {f} {method}: {areas[row, f]:.6g} +- "
                f"{bounds[row, f]:.3g} ({excess[row, f]:.3g}) of {mesh.areas[f]:.6g} m2"
                for f in np.flatnonzero(wrong)
            ]
    return lines


def visible_areas(mesh, camera, pose):
    """(F,) px^2 of each face twice: where of coincident faces the index decides, or the depth."""
    by_index = np.asarray(rational.visible_area(mesh, camera, pose))
    tie = rational.TIE
    try:
        rational.TIE = tie**4
        return by_index, np.asarray(rational.visible_area(mesh, camera, pose))
    finally:
        rational.TIE = tie


def wrong_areas(mesh, camera, pose, truth, figures):
    """(F,) areas that break their bounds, of faces that are seen as a whole or not at all."""
    visible, image, side = truth
    area, bound, excess = figures
    points = (mesh.vertices[mesh.faces] - pose[:3, 3]) @ pose[:3, :3]
    depth = points[..., 2]
    with np.errstate(all="ignore"):
        u = camera.fx * points[..., 0] / depth + camera.cx
        v = camera.fy * points[..., 1] / depth + camera.cy
    is_in = (u > 1e-6) & (u < camera.width - 1e-6) & (v > 1e-6) & (v < camera.height - 1e-6)
    is_in &= depth > 1e-3 * np.ptp(mesh.bounds)
    whole = is_in.all(axis=1) & (visible == image) & (side > 0)
    none = (visible == 0) | (side <= 0)
    slack = ROUNDING * mesh.areas + OF_FRAME * np.abs(mesh.vertices).max() ** 2
    true = np.where(whole, mesh.areas, 0.0)
    wrong = (whole | none) & (mesh.areas > 0)
    wrong &= (np.abs(area - true) > bound + slack) | (area - excess > true + slack)
    return wrong | ((side <= 0) & (area + bound > 0))


def scene(rng):
    """Boxes with coordinates of a grid, and needles before them; as they are, rotated, or far."""
    parts = []
    for _ in range(rng.integers(1, 4)):
        low = rng.integers(-4, 5, 3) / 2
        parts.append(box(tuple(low), tuple(low + rng.integers(1, 5, 3) / 2)))
    mesh = joined(*parts)
    vertices, faces = mesh.vertices, mesh.faces
    if rng.random() < 0.5:
        vertices, faces = with_needles(vertices, faces, rng)
    if rng.random() < 0.5:
        axis, angle = rng.normal(size=3), rng.uniform(0, 3)
        vertices = vertices @ rotation(axis / np.linalg.norm(axis), angle).T
    if rng.random() < 0.4:
        vertices = vertices + rng.normal(size=3) * 10.0 ** rng.uniform(0, 6)
    return rc.Mesh(vertices, faces)


def with_needles(vertices, faces, rng):
    """Faces besides whose corners lie on a line except for rounding."""
    n = int(rng.integers(1, 4))
    start, way = rng.uniform(-3, 3, (n, 3)), rng.normal(size=(n, 3))
    share = rng.random((n, 1))
    corners = np.stack([start, start + way * share, start + way], axis=1)
    corners += rng.normal(size=corners.shape) * rng.choice((0, 1e-16, 1e-15, 1e-13))
    if rng.random() < 0.3:
        corners[:, 2] = corners[:, 0]
    more = len(vertices) + np.arange(3 * n).reshape(n, 3)
    return np.concatenate([vertices, corners.reshape(-1, 3)]), np.concatenate([faces, more])


def rotation(axis, angle):
    """Matrix of a rotation about a unit vector."""
    x = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(angle) * x + (1 - np.cos(angle)) * x @ x


def pose_in_plane(mesh, rng):
    """A camera in the plane of a face, on its edge or vertex, or beside it by rounding and more."""
    face = mesh.vertices[mesh.faces[rng.integers(mesh.n_faces)]]
    size = np.ptp(mesh.bounds)
    kind = rng.integers(5)
    if kind == 0:
        eye = face[rng.integers(3)].copy()
    elif kind == 1:
        eye = face[0] + (face[1] - face[0]) * rng.choice((0.25, 0.5, 2.0, -1.0, rng.normal()))
    elif kind == 2:  # a coordinate of a face, a height that people type
        eye = mesh.bounds.mean(axis=0) + rng.integers(-16, 17, 3) / 2
        axis = rng.integers(3)
        eye[axis] = face[rng.integers(3), axis]
    else:
        eye = face[0] + rng.integers(-4, 5, 2) / 2 @ (face[1:] - face[0])
    if rng.random() < 0.5:
        axis = rng.integers(3)
        if rng.random() < 0.5:
            eye[axis] = np.nextafter(eye[axis], rng.choice((-np.inf, np.inf)))
        else:
            eye = eye + rng.normal(size=3) * 10.0 ** rng.uniform(-16, -9)
    target = mesh.vertices[mesh.faces[rng.integers(mesh.n_faces)]].mean(axis=0)
    if np.linalg.norm(target - eye) < 1e-6 * size:
        target = eye + rng.normal(size=3)
    return rc.look_at(eye, target, rng.normal(size=3))[0]
