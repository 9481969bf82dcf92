"""Poses per second with face counts: rastercov's two rasterisers against Open3D's ray tracer.

All go from a pose to its counts on the same two cores in the same run: rastercov on the CPU in two
threads, on software OpenGL in two spawned processes with one Mesa thread each, and Open3D in one
process with two threads, which makes its rays (`create_rays_pinhole`), casts them and counts with
numpy; a second ratio leaves its rays out of the time. `visible` counts only. Rounds alternate; the
figures are medians over rounds. Before any timing the images are compared with Open3D's: they may
differ only where a pixel centre is within 4e-3 px of an edge of one of the two faces, or where two
surfaces are within 1e-4 of each other in depth.
"""

import multiprocessing
import os
import statistics
import time
from multiprocessing.connection import Connection

import numpy as np
from rows import Report, arguments
from tracer import Tracer, need_open3d

import rastercov as rc
from rastercov import shapes
from rastercov.projection import to_camera, to_image

SCENES = {
    # name: mesh, distance of the cameras; the room is seen from inside
    "torus, 10,000 faces": ("torus", 4.2),
    "teapot, 9,120 faces, open": ("teapot-12", 0.55),
    "aeroplane, 9,856 faces": ("aeroplane-9856", 38.0),
    "room, 1,344 faces, from inside": ("room", 0.0),
}
SIZES = ((1280, 1024), (256, 256))
MUST = {("torus", 1280): 15.0, ("torus", 256): 5.0}
WORKERS = 2
CPU = ("CPU", {"backend": "cpu", "threads": WORKERS})
ONE_THREAD = {"LP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=40, help="poses a round, 8 times that at 256")
    parser.add_argument("--rounds", type=int, default=7, help="rounds of each contestant")
    args = parser.parse_args()
    report = Report()
    need_open3d()
    for what, (name, distance) in SCENES.items():
        for width, height in SIZES:
            _contest(report, what, name, distance, width, height, args)
    report.finish(args.json)


def _contest(report, what, name, distance, width, height, args) -> None:
    mesh, camera = shapes.by_name(name), _camera(width, height)
    poses = _poses(mesh, distance, args.poses * (8 if width == 256 else 1))
    tracer = Tracer(mesh, camera, poses, WORKERS)
    label = f"{what}, {width} x {height}"

    for kind, options in (("OpenGL", {"backend": "gl", "device": "surfaceless"}), CPU):
        with rc.open_rasterizer(mesh, camera, **options) as rasterizer:
            _compare(report, f"{label}, {kind}", rasterizer, tracer, poses)

    with (
        _Workers(name, width, height, poses) as workers,
        rc.open_rasterizer(mesh, camera, **CPU[1]) as rasterizer,
    ):
        rounds = [
            (workers.round(), _timed(rasterizer, poses), *tracer.round())
            for _ in range(args.rounds + 1)
        ][1:]
    gl, cpu, theirs, casting = (
        len(poses) / statistics.median(t) for t in zip(*rounds, strict=True)
    )
    report.add(f"{label}: OpenGL, {WORKERS} processes", gl, "poses/s")
    report.add(f"{label}: CPU, {WORKERS} threads", cpu, "poses/s")
    report.add(f"{label}: Open3D, {WORKERS} threads", theirs, "poses/s")
    report.add(f"{label}: ratio, OpenGL", gl / theirs, "x", MUST.get((name, width)))
    report.add(f"{label}: ratio, CPU", cpu / theirs, "x")
    report.add(f"{label}: ratio, OpenGL, rays for free", gl / casting, "x")
    report.add(f"{label}: ratio, CPU, rays for free", cpu / casting, "x")


def _compare(report, label, rasterizer, tracer, poses) -> None:
    """Check the image of every few poses against the rays, and the counts against the image."""
    mesh, camera = rasterizer.mesh, rasterizer.camera
    unexcused = differing = 0
    for row in range(0, len(poses), max(1, len(poses) // 4)):
        ours, theirs = rasterizer.render(poses[row]).face, tracer.faces(row)
        different = np.argwhere(ours != theirs)
        differing += len(different)
        for y, x in different:
            faces = (int(ours[y, x]), int(theirs[y, x]))
            unexcused += not _is_excused(mesh, camera, poses[row], (x + 0.5, y + 0.5), faces)
    counts = rasterizer.count(poses[:1], drawn=False).visible[0]
    face = rasterizer.render(poses[0]).face
    from_image = np.bincount(face[face >= 0], minlength=mesh.n_faces)
    report.add(f"{label}: pixels that differ", differing, "pixels")
    report.check(f"{label}: same faces up to ties", unexcused == 0)
    report.check(f"{label}: counts are those of the image", np.array_equal(counts, from_image))


def _timed(rasterizer: rc.Rasterizer, poses: np.ndarray) -> float:
    started = time.perf_counter()
    rasterizer.count(poses, drawn=False)
    return time.perf_counter() - started


def _camera(width: int, height: int) -> rc.Camera:
    return rc.Camera(width=width, height=height, fx=1.2 * height, fy=1.2 * height)


def _poses(mesh: rc.Mesh, distance: float, count: int) -> np.ndarray:
    centre = mesh.bounds.mean(axis=0)
    if distance:
        return rc.sphere_of_poses(centre, distance, count)
    rng = np.random.default_rng(1)
    eyes = centre + rng.uniform(-0.3, 0.3, (count, 3)) * np.ptp(mesh.bounds, axis=0)
    return rc.look_at(eyes, eyes + rng.normal(size=(count, 3)))


def _is_excused(mesh, camera, pose, point, faces) -> bool:
    """Whether a pixel centre is on an edge of one of its two faces, or these are as deep."""
    depths = []
    for face in faces:
        if face < 0:
            continue
        corners = to_camera(mesh.vertices[mesh.faces[face]], pose)
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        ray = np.array(((point[0] - camera.cx) / camera.fx, (point[1] - camera.cy) / camera.fy, 1))
        depths.append(normal @ corners[0] / (normal @ ray))
        if corners[:, 2].min() <= 0:
            # Project the edges' planes instead: distance of the ray from each, in pixels.
            planes = np.cross(corners, np.roll(corners, -1, axis=0))
            slopes = np.hypot(planes[:, 0] / camera.fx, planes[:, 1] / camera.fy)
            distances = np.abs(planes @ ray) / slopes
        else:
            image = to_image(corners, camera)
            ahead = np.roll(image, -1, axis=0) - image
            away = np.asarray(point) - image
            along = np.clip((away * ahead).sum(1) / np.maximum((ahead**2).sum(1), 1e-30), 0, 1)
            distances = np.linalg.norm(away - along[:, None] * ahead, axis=1)
        if distances.min() < 4e-3:
            return True
    return len(depths) == 2 and abs(depths[0] - depths[1]) < 1e-4 * min(np.abs(depths))


class _Workers:
    """Spawned processes, each with a rasteriser and its share of the poses."""

    def __init__(self, name: str, width: int, height: int, poses: np.ndarray) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.pipes: list[Connection] = []
        self.processes = []
        # Read when the child loads the libraries: a process gets one core's worth of each.
        os.environ |= ONE_THREAD
        for worker in range(WORKERS):
            ours, theirs = spawn.Pipe()
            share = poses[worker::WORKERS]
            process = spawn.Process(target=_work, args=(theirs, name, width, height, share))
            process.start()
            self.pipes.append(ours)
            self.processes.append(process)
        for pipe in self.pipes:
            pipe.recv()

    def round(self) -> float:
        """Seconds until the last process has counted its share."""
        started = time.perf_counter()
        for pipe in self.pipes:
            pipe.send("count")
        for pipe in self.pipes:
            pipe.recv()
        return time.perf_counter() - started

    def __enter__(self) -> "_Workers":
        return self

    def __exit__(self, *_: object) -> None:
        for pipe in self.pipes:
            pipe.send("stop")
        for process in self.processes:
            process.join()
        for name in ONE_THREAD:
            del os.environ[name]


def _work(pipe: Connection, name: str, width: int, height: int, poses: np.ndarray) -> None:
    with rc.open_rasterizer(
        shapes.by_name(name), _camera(width, height), "gl", device="surfaceless"
    ) as rasterizer:
        rasterizer.count(poses[:2], drawn=False)
        pipe.send("ready")
        while pipe.recv() == "count":
            rasterizer.count(poses, drawn=False)
            pipe.send("done")


if __name__ == "__main__":
    main()
