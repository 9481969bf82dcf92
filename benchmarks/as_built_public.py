"""Poses by eight points from public photographs, against the published poses.

The photographs are not part of the project. --chessboards: `examples/data` of Debian's package
opencv-doc: 13 photographs of a chessboard, with the lens and the poses of a calibration; corners by
OpenCV, to 0.2 px. --surveyed: `Herz-Jesus-P8` of the repository openMVG/SfM_quality_evaluation
(Strecha and others. On benchmarking camera calibration. 2008): a facade at 15 m, with surveyed
poses; features by OpenCV, to 1 px, and their places from the other photographs.

    dpkg-deb -x opencv-doc_*.deb build/opencv
    python benchmarks/as_built_public.py --surveyed build/Herz-Jesus-P8 \
        --chessboards build/opencv/usr/share/doc/opencv-doc/examples/data
"""

from collections import defaultdict
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
from rows import Report, arguments
from scipy.spatial import Delaunay

import rastercov as rc
from rastercov.asbuilt.resection import difference

CHI_95 = 12.592
"""Chi-squared of six degrees of freedom at 95 %."""
SETS = 30
"""Sets of eight points of a photograph."""
BOARD = 9, 6
"""Inner corners of the chessboard."""
LEAST = 4
"""Photographs in which a feature is found."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--chessboards", type=Path)
    parser.add_argument("--surveyed", type=Path)
    args = parser.parse_args()
    report = Report()
    if args.chessboards is None and args.surveyed is None:
        print("skipped: no photographs; name their folders")
    if args.chessboards:
        chessboards(report, args.chessboards)
    if args.surveyed:
        surveyed(report, args.surveyed)
    report.finish(args.json)


def chessboards(report: Report, folder: Path) -> None:
    """Poses by eight corners, against those published, and OpenCV's of all 54."""
    file = cv2.FileStorage(str(folder / "left_intrinsics.yml"), cv2.FILE_STORAGE_READ)
    matrix = file.getNode("camera_matrix").mat()
    lens = file.getNode("distortion_coefficients").mat()
    published = file.getNode("extrinsic_parameters").mat()
    size = file.getNode("square_size").real()
    points = np.array([(x, y, 0) for y in range(BOARD[1]) for x in range(BOARD[0])]) * size
    (fx, _, cx), (_, fy, cy) = matrix[:2]
    camera = rc.Camera(
        width=640, height=480, fx=fx, fy=fy, cx=cx + 0.5, cy=cy + 0.5,
        model="opencv", distortion=tuple(lens.ravel()),
    )  # fmt: skip
    mesh = rc.Mesh(points, Delaunay(points[:, :2]).simplices)
    against = defaultdict(list)
    for path, row in zip(sorted(folder.glob("left[0-9]*.jpg")), published, strict=True):
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        corners = cv2.findChessboardCorners(grey, BOARD)[1]
        corners = cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), (3, 100, 1e-3)).reshape(-1, 2)
        expected = cv2.projectPoints(points, row[:3], row[3:], matrix, lens)[0].reshape(-1, 2)
        if np.abs(expected - corners).max() > np.abs(expected - corners[::-1]).max():
            corners = corners[::-1]
        of_all = np.ravel(cv2.solvePnP(points, corners.astype(np.float64), matrix, lens)[1:])
        own = cv2.projectPoints(points, of_all[:3], of_all[3:], matrix, lens)[0].reshape(-1, 2)
        errors = [np.sqrt(((each - corners) ** 2).sum(axis=1).mean()) for each in (expected, own)]
        print(f"{path.name}: {errors[0]:.2f} px as published, {errors[1]:.2f} px by OpenCV anew")
        poses = {"published": _pose(row), "OpenCV's of 54 corners": _pose(of_all)}
        _locate(against, mesh, camera, corners + 0.5, points, poses, 0.2)
    _summarise(report, "chessboard", against)


def _pose(vectors: np.ndarray) -> np.ndarray:
    """world_from_camera of a rotation vector and a translation of the world."""
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(vectors[:3])[0]
    pose[:3, 3] = vectors[3:]
    return np.linalg.inv(pose)


def _locate(
    against: dict[str, list[tuple[bool, bool, float, float]]],
    mesh: rc.Mesh,
    camera: rc.Camera,
    pixels: np.ndarray,
    points: np.ndarray,
    poses: dict[str, np.ndarray],
    sigma: float,
) -> None:
    """Poses of random sets of eight points, and their differences from others."""
    rng = np.random.default_rng(0)
    blank = np.zeros((camera.height, camera.width), np.float32)
    for _ in range(SETS):
        own = rng.choice(len(points), 8, replace=False)
        pairs = np.hstack((pixels[own], points[own]))
        found = rc.locate(mesh, camera, blank, points=pairs, pixel_error=sigma)
        for name, pose in poses.items():
            step = difference(found.pose, pose)
            square = step @ np.linalg.pinv(found.covariance) @ step if found.accepted else np.inf
            apart = np.linalg.norm(step[3:]), np.degrees(np.linalg.norm(step[:3]))
            against[name].append((found.accepted, square < CHI_95, *apart))


def surveyed(report: Report, folder: Path) -> None:
    """Poses by eight features, against those surveyed."""
    paths = sorted((folder / "images").glob("*.jpg"))
    cameras = [
        np.array((folder / "gt_dense_cameras" / f"{path.name}.camera").read_text().split(), float)
        for path in paths
    ]
    features = [
        cv2.SIFT_create(4000).detectAndCompute(  # type: ignore[attr-defined]
            cv2.imread(str(path), 0), None
        )
        for path in paths
    ]
    places = [np.array([each.pt for each in keys]) for keys, _ in features]
    lenses = [values[:9].reshape(3, 3) for values in cameras]
    poses = [_rigid(values) for values in cameras]
    shots = [lens @ np.linalg.inv(pose)[:3] for lens, pose in zip(lenses, poses, strict=True)]
    against = defaultdict(list)
    tracks = list(_tracks([described for _, described in features]))
    for row, lens in enumerate(lenses):
        pixels, points = [], []
        for track in (each for each in tracks if row in each):
            others = [(shots[k], places[k][at]) for k, at in track.items() if k != row]
            point, error = _triangulated(others)
            if error < 1:
                pixels.append(places[row][track[row]])
                points.append(point)
        pixels, points = np.array(pixels), np.array(points)
        (fx, skew, cx), (_, fy, cy) = lens[:2]
        camera = rc.Camera(
            width=3072, height=2048, fx=fx, fy=fy, cx=cx + 0.5, cy=cy + 0.5, skew=skew
        )
        mesh = rc.Mesh(points, Delaunay(pixels).simplices)
        _locate(against, mesh, camera, pixels + 0.5, points, {"surveyed": poses[row]}, 1.0)
    _summarise(report, "facade", against)


def _rigid(values: np.ndarray) -> np.ndarray:
    """Pose of a file, whose rotation has six digits."""
    pose = np.eye(4)
    left, _, right = np.linalg.svd(values[12:21].reshape(3, 3))
    pose[:3, :3] = left @ right
    pose[:3, 3] = values[21:24]
    return pose


def _tracks(described: list[np.ndarray]) -> Iterator[dict[int, int]]:
    """Features that photographs have in common: the feature of each photograph."""
    parent: dict[tuple[int, int], tuple[int, int]] = {}

    def first(key: tuple[int, int]) -> tuple[int, int]:
        while parent.setdefault(key, key) != key:
            key = parent[key]
        return key

    for a, b in combinations(range(len(described)), 2):
        there, back = (dict(_matches(described[i], described[j])) for i, j in ((a, b), (b, a)))
        for i, j in there.items():
            if back.get(j) == i:
                parent[first((a, i))] = first((b, j))
    groups = defaultdict(list)
    for key in list(parent):
        groups[first(key)].append(key)
    for keys in groups.values():
        track = dict(keys)
        if LEAST <= len(track) == len(keys):
            yield track


def _matches(own: np.ndarray, other: np.ndarray) -> Iterator[tuple[int, int]]:
    """Features whose nearest of another photograph is much nearer than the second."""
    for best, second in cv2.BFMatcher().knnMatch(own, other, 2):
        if best.distance < 0.7 * second.distance:
            yield best.queryIdx, best.trainIdx


def _triangulated(shots: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, float]:
    """Point of pixels in several photographs, and its largest reprojection error, px."""
    equations = [pixel[axis] * shot[2] - shot[axis] for shot, pixel in shots for axis in range(2)]
    point = np.linalg.svd(np.array(equations))[2][-1]
    point = point / point[3]
    images = [(shot @ point, pixel) for shot, pixel in shots]
    errors = [np.linalg.norm(each[:2] / each[2] - pixel) for each, pixel in images if each[2] > 0]
    return point[:3], max(errors) if len(errors) == len(shots) else np.inf


def _summarise(
    report: Report, name: str, against: dict[str, list[tuple[bool, bool, float, float]]]
) -> None:
    """Rows of a set of photographs."""
    for other, rows in against.items():
        accepted, within, place, turn = np.array(rows, dtype=float).T
        held = accepted > 0
        what = f"{name}, eight points: "
        report.add(f"{what}accepted", float(held.mean()), f"of {len(held)}")
        report.add(
            f"  in the ellipse of 95 % of {other}", float(within[held].mean()), "of the accepted"
        )
        report.add("  place, median", 1000 * float(np.median(place[held])), "mm")
        report.add("  direction, median", float(np.median(turn[held])), "deg")


if __name__ == "__main__":
    main()
