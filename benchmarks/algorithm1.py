"""Errors of the thesis' Algorithm 1 on built-in meshes, against exact polygon visibility.

Pairs of face and pose are pooled over poses around the mesh, 1280 x 960 px. Errors are of the
occlusion (3.13) of front faces of at least 0.1 px^2, with faces seen from behind hiding others as
any face does; "centroid sort" is the charitable reading. `docs/appendix/equations.md` has the
figures.
"""

import numpy as np
import shapely
from rows import Report, arguments

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.reference.algorithm1 import image_triangles, occlusion, self_occluding
from rastercov.reference.polygons import visible_area

FAR, CLOSE = 1536.0, 700.0  # focal lengths in pixels, for views of about the same size
SCENES = {
    # name: mesh, distance of the cameras in metres, focal length
    "teapot, 1,560 faces": ("teapot-5", 0.55, FAR),
    "teapot, 1,560 faces, close": ("teapot-5", 0.28, CLOSE),
    "teapot, 9,120 faces": ("teapot-12", 0.55, FAR),
    "teapot, 9,120 faces, close": ("teapot-12", 0.28, CLOSE),
    "aeroplane, 1,970 faces": ("aeroplane", 38.0, FAR),
    "room, 1,344 faces, from inside": ("room", 0.0, CLOSE),
}
ITERATED_FACES = 2000
"""The readings that iterate cost seconds a pose up to here, and grow with the square."""
LEAST_AREA = 0.1  # px^2


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=3, help="poses a scene")
    args = parser.parse_args()
    report = Report()
    ball = shapes.sphere(2)
    wrong, _ = _errors(ball, _camera(FAR), rc.sphere_of_poses((0, 0, 0), 4.0, 2), "charitable")
    report.check("nothing hides the front of a ball, says the centroid sort", wrong.max() < 1e-9)
    for what, (name, distance, focal_length) in SCENES.items():
        mesh, camera = shapes.by_name(name), _camera(focal_length)
        poses = _poses(mesh, distance, args.poses)
        _self_occlusion(report, what, mesh, camera, poses)
        _order(report, what, mesh, camera, poses)
    report.finish(args.json)


def _self_occlusion(report, what, mesh, camera, poses) -> None:
    """Definition 3 against the perspective test, over faces with area in the image."""
    pairs = differing = seen = 0
    for pose in poses:
        areas = shapely.area(image_triangles(mesh, camera, pose))
        wrong = self_occluding(mesh, pose) != self_occluding(mesh, pose, "perspective")
        wrong &= areas >= LEAST_AREA
        pairs += int((areas >= LEAST_AREA).sum())
        differing += int(wrong.sum())
        hidden_by_itself = wrong & self_occluding(mesh, pose)
        faces = np.flatnonzero(hidden_by_itself)
        visible = visible_area(mesh, camera, pose, faces)
        seen += int((visible > 0.01 * areas[faces]).sum())
    report.add(f"{what}: faces in view", pairs, "faces")
    report.add(f"{what}: Definition 3 is wrong", 100 * differing / pairs, "%")
    report.add(f"{what}: visible, yet called self-occluding", seen, "faces")


def _order(report, what, mesh, camera, poses) -> None:
    """Each reading against the exact answer, and the effect of numbering the faces backwards."""
    wrong, areas = _errors(mesh, camera, poses, "charitable")
    gross = int((wrong > 0.5).sum())
    report.add(f"{what}: front faces", len(wrong), "faces")
    report.add(f"{what}: centroid sort errs by more than 0.01", *_share(wrong > 0.01))
    report.add(f"{what}: centroid sort errs by more than 0.5", gross, "faces")
    report.add(f"{what}: centroid sort, worst error", float(wrong.max()), "")
    misjudged = float(100 * (wrong @ areas) / areas.sum())
    report.add(f"{what}: centroid sort misjudges", misjudged, "% of their area")
    if mesh.n_faces > ITERATED_FACES:
        return
    for reading in ("semi", "literal"):
        wrong, _ = _errors(mesh, camera, poses, reading)
        report.add(f"{what}: {reading} errs by more than 0.01", *_share(wrong > 0.01))
    backwards = rc.Mesh(vertices=mesh.vertices, faces=mesh.faces[::-1])
    change = []
    for pose in poses:
        hidden = occlusion(mesh, camera, pose, "semi", self_occlusion="perspective")
        other = occlusion(backwards, camera, pose, "semi", self_occlusion="perspective")[::-1]
        faces, _ = _front_faces(mesh, camera, pose)
        change.append(abs(hidden - other)[faces])
    hangs = np.concatenate(change) > 0.01
    report.add(f"{what}: semi changes when faces are numbered backwards", *_share(hangs))


def _errors(mesh, camera, poses, reading):
    """Errors of the occlusion by a reading, and areas in px^2, of the front faces of all poses."""
    pairs = []
    for pose in poses:
        faces, areas = _front_faces(mesh, camera, pose)
        exact = 1 - visible_area(mesh, camera, pose, faces) / areas
        hidden = occlusion(mesh, camera, pose, reading, self_occlusion="perspective")[faces]
        pairs.append((abs(hidden - exact), areas))
    wrong, areas = (np.concatenate(arrays) for arrays in zip(*pairs, strict=True))
    return wrong, areas


def _front_faces(mesh, camera, pose):
    areas = shapely.area(image_triangles(mesh, camera, pose))
    is_back = self_occluding(mesh, pose, "perspective")
    faces = np.flatnonzero(~is_back & (areas >= LEAST_AREA))
    return faces, areas[faces]


def _share(wrong):
    return float(100 * wrong.mean()), "% of front faces"


def _camera(focal_length):
    return rc.Camera(width=1280, height=960, fx=focal_length, fy=focal_length)


def _poses(mesh, distance, count):
    middle = mesh.bounds.mean(axis=0)
    if distance:
        return rc.sphere_of_poses(middle, distance, count)
    angles = 2 * np.pi / count * np.arange(count) + 0.4
    outward = np.stack([np.cos(angles), np.sin(angles), 0 * angles - 0.1], axis=1)
    return rc.look_at(middle, middle + outward)


if __name__ == "__main__":
    main()
