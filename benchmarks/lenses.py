"""Lenses: inverses, sums of areas, bounds, and cost; `truth.py` compares pixels with others.

Each camera of tests/support/lens_cases.py: rays of random pixels there and back, areas of the walls
of a turned room, which must add up to the image, and the longest edges that the quadrature takes to
1e-9 px^2. Then the cost of pixels, rays and edges, and of poses by `certified`, by counting samples
and by evaluating figures beside the pinhole (`--only poses` is that alone), and of counts and
pictures of small and of large faces (`--only pictures`); medians over the rounds, of one thread.
"""

import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray
from rows import Report, arguments  # makes tests/support importable

# isort: split
import lens_cases
from lens_cases import (
    BROWN,
    HEIGHT,
    KANNALA,
    WIDTH,
    of_all_kinds,
    pixels,
    polygon_areas,
    rays,
)
from lens_rooms import on_plane, room

from rastercov import (
    Camera,
    Mesh,
    look_at,
    open_observer,
    open_rasterizer,
    sphere_of_poses,
)
from rastercov.core.camera.lenses.of_camera import LensModel, planes_of
from rastercov.core.camera.viewpoints import enclosing_distance
from rastercov.core.coverage.coverage import evaluate_batches
from rastercov.core.mesh import shapes
from rastercov.reference.lenses import project

MOST_RAD, MOST_PX2 = 1e-11, 1e-6


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--rays", type=int, default=4000)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--only", choices=("poses", "pictures"), help="cost of poses, no agreement")
    args = parser.parse_args()
    report = Report()
    if args.only is None:
        add_models(report, args.rays, args.rounds)
    if args.only != "pictures":
        add_poses(report, args.rounds)
    if args.only != "poses":
        add_pictures(report, args.rounds)
    report.finish(args.json)


def add_models(report: Report, n_rays: int, rounds: int) -> None:
    """Rays there and back, sums of areas, and the cost of rays and edges."""
    lenses = of_all_kinds()
    for name, lens in lenses.items():
        rays = lens.unproject(pixels(n_rays))
        again = lens.unproject(lens.project(rays))
        report.add(f"{name}: ray to pixel to ray", np.abs(again - rays).max(), "",
                   at_most=MOST_RAD)  # fmt: skip
        total = sum(
            polygon_areas(each, on_plane(each.record, room(3))).inside.sum() for each in lens.proved
        )
        report.add(f"{name}: room less image", abs(total - WIDTH * HEIGHT), "px^2",
                   at_most=MOST_PX2)  # fmt: skip
    report.add("k1 = -0.2, f = 900: folded directions", 100 * folded_share(), "% of those in image")
    for name in ("opencv brown", "opencv prism", "opencv fisheye", "kalibr ds"):
        proved = lenses[name].proved[0]
        for n in (3, 4, 5, 7, 11):
            length = 2 * proved.record.longest[n] * proved.camera.fx
            report.add(f"{name}: longest edge with n = {n}", length, "px")
    for name in ("opencv brown", "opencv prism", "opencv fisheye", "kalibr ds"):
        add_cost(report, name, lenses[name], rounds)


def folded_share() -> float:
    """Share of the directions within 89 degrees with a pixel in the image that are folded there."""
    lens = lens_cases.lens("metashape", (-0.2, 0, 0, 0, 0, 0), f=900)
    given = rays(400_000, least_z=np.cos(np.radians(89)))
    u, v = project(lens.code, lens.params, *given.T)
    is_in = (u >= 0) & (u <= WIDTH) & (v >= 0) & (v <= HEIGHT)
    angle = np.arccos(given[is_in, 2])
    return float((angle > np.arctan(np.sqrt(1 / 0.6))).mean())


def add_cost(report: Report, name: str, lens: LensModel, rounds: int) -> None:
    where = pixels(200_000)
    rays = lens.unproject(where)
    proved = lens.proved[0]
    rng = np.random.default_rng(0)
    middle = rng.uniform(-0.5, 0.5, (10_000, 1, 2))
    corners = middle + rng.normal(size=(10_000, 3, 2)) * 5 / proved.camera.fx
    faces = list(corners)
    for what, count, call in (
        ("pixel of a ray", len(rays), lambda: lens.project(rays)),
        ("ray of a pixel", len(where), lambda: lens.unproject(where)),
        ("edge of 10 px", 30_000, lambda: polygon_areas(proved, faces)),
    ):
        report.add(f"{name}: {what}", 1e9 * median(call, rounds) / count, "ns")


def scenes(n_poses: int) -> Iterator[tuple[str, Mesh, dict[str, Camera], NDArray[np.float64]]]:
    """Yield title, mesh, cameras by name, the pinhole first, and poses of each scene."""
    meshes = {
        "torus": shapes.by_name("torus"),
        "aeroplane-9856": shapes.aeroplane(9856),
        "teapot": shapes.by_name("teapot"),
        "room": shapes.by_name("room"),
    }
    looks = np.resize([(1, 1, 1), (-1, 1, 1), (1, -1, 1.3), (-1, 0.3, 1)], (n_poses, 3))
    for width, height in ((1280, 1024), (640, 512)):
        f = 900 * width / 1280
        pinhole = Camera(width=width, height=height, fx=f, fy=f)
        brown = replace(pinhole, model="opencv", distortion=BROWN)
        fisheye = replace(
            pinhole, fx=f / 1.5, fy=f / 1.5, model="opencv_fisheye", distortion=KANNALA
        )
        cameras = {"pinhole": pinhole, "brown": brown, "fisheye": fisheye}
        for name, mesh in meshes.items():
            if name == "room":
                poses = look_at([(0.2, 0.1, 1.5)] * n_poses, looks)
            else:
                centre = mesh.bounds.mean(axis=0)
                distance = enclosing_distance(mesh, pinhole, centre)[1]
                poses = sphere_of_poses(centre, distance, n_poses)
            yield f"{name}, {width} x {height}", mesh, cameras, poses


def add_poses(report: Report, rounds: int) -> None:
    """CPU time of a pose through lenses, and by that of the pinhole, in alternating runs.

    A fisheye sees more faces than the pinhole beside it. So its time is also compared with that of
    its ideal pinholes: plain cameras that see the same directions, see `ideal_pinholes`.
    """
    for title, mesh, cameras, poses in scenes(4):
        with ExitStack() as stack:
            counts, certified = [], []
            for views in [
                *([(camera, poses)] for camera in cameras.values()),
                *(ideal_pinholes(mesh, camera, poses) for camera in list(cameras.values())[1:]),
            ]:
                counters, observers = [], []
                for camera, own in views:
                    rasterizer = open_rasterizer(mesh, camera, "cpu", threads=1)
                    counter = stack.enter_context(rasterizer)
                    counters.append(partial(counter.count, own, drawn=False))
                    observer = stack.enter_context(open_observer(mesh, camera, threads=1))
                    observers.append(partial(observer.observe, own))
                counts.append(partial(call_all, counters))
                certified.append(partial(call_all, observers))
            n = len(cameras)
            for what, calls in evaluations(stack, mesh, cameras.values(), poses).items():
                times = alternating(calls, rounds) / len(poses)
                add_beside_pinhole(report, title, what, list(cameras), times)
            for what, calls in (("count", counts), ("certified", certified)):
                times = alternating(calls, rounds) / len(poses)
                add_beside_pinhole(report, title, what, list(cameras), times[:n])
                for lens, own, ideal in zip(list(cameras)[1:], times[1:n], times[n:], strict=True):
                    ratio = statistics.median(own / ideal)
                    whole = f"{title}, {lens}: {what} by that of its ideal pinholes"
                    report.add(whole, ratio, "")


def add_pictures(report: Report, rounds: int) -> None:
    """CPU time of counts and pictures of a pose, by that of a pinhole of the same focal length.

    The mesh is within the image, or fills it and goes beyond.
    """
    cameras: dict[str, tuple[str, tuple[float, ...]]] = {
        "k1 = -0.24": ("opencv", (-0.24, 0.08, 0, 0)),
        "k1 = -0.1": ("opencv", (-0.1, 0, 0, 0)),
        "fisheye": ("opencv_fisheye", (0.02, -0.01, 0.005, 0)),
    }
    plain = Camera(width=1280, height=1024, fx=1100, fy=1100)
    meshes = {"aeroplane-9856": (shapes.aeroplane(9856), 0.35),
              "torus-99856": (shapes.torus(316, 158), 0.45)}  # fmt: skip
    for (name, (mesh, near)), is_near in product(meshes.items(), (False, True)):
        centre = mesh.bounds.mean(axis=0)
        distance = enclosing_distance(mesh, plain, centre)[1] * (near if is_near else 1)
        poses = sphere_of_poses(centre, distance, 8)
        for lens, (model, distortion) in cameras.items():
            f = plain.fx / 1.5 if lens == "fisheye" else plain.fx
            pinhole = replace(plain, fx=f, fy=f)
            with ExitStack() as stack:
                open_ones = [
                    stack.enter_context(open_rasterizer(mesh, camera, "cpu", threads=1))
                    for camera in (pinhole, replace(pinhole, model=model, distortion=distortion))
                ]
                for what, calls in {
                    "count with drawn": [partial(one.count, poses) for one in open_ones],
                    "count": [partial(one.count, poses, drawn=False) for one in open_ones],
                    "picture": [
                        partial(call_all, [partial(one.render, pose) for pose in poses])
                        for one in open_ones
                    ],
                }.items():
                    times = alternating(calls, rounds) / len(poses)
                    title = f"{name}, {'beyond' if is_near else 'within'} the image"
                    add_beside_pinhole(report, title, what, ["pinhole", lens], times)


def ideal_pinholes(
    mesh: Mesh, camera: Camera, poses: NDArray[np.float64]
) -> list[tuple[Camera, NDArray[np.float64]]]:
    """Plain pinholes that see what a lens sees, each with its poses.

    They have the sizes and the resolutions of the planes of the lens, and only those poses in
    which they see some face.
    """
    views = []
    for each in planes_of(camera):
        if not len(each.record.window):
            continue
        turned = poses.copy()
        turned[:, :3, :3] = poses[:, :3, :3] @ each.record.frame
        with open_observer(mesh, each.camera, threads=1) as observer:
            is_seen = (observer.observe(turned).drawn_pixels > 0).any(axis=1)
        if is_seen.any():
            views.append((each.camera, turned[is_seen]))
    return views


def evaluations(
    stack: ExitStack, mesh: Mesh, cameras: Iterable[Camera], poses: NDArray[np.float64]
) -> dict[str, list[Callable[[], object]]]:
    """Calls that find all figures, and the coverage alone, of open observers of the cameras."""
    functions_by_key: dict[str, list[Callable[[], object]]] = {}
    for method in ("certified", "sampled:cpu"):
        observers = [
            stack.enter_context(open_observer(mesh, camera, method, threads=1))
            for camera in cameras
        ]
        for what, fields in (("all figures", None), ("coverage", ["coverage"])):
            functions_by_key[f"{what}, {method.partition(':')[0]}"] = [
                lambda observer=observer, fields=fields: list(
                    evaluate_batches(observer, poses, fields=fields)
                )
                for observer in observers
            ]
    return functions_by_key


def call_all(calls: Sequence[Callable[[], object]]) -> None:
    """Make some calls one after another."""
    for call in calls:
        call()


def add_beside_pinhole(
    report: Report, title: str, what: str, lenses: Sequence[str], times: NDArray[np.float64]
) -> None:
    """Rows of the seconds (lenses, rounds) of a pose, and of their ratios to the first lens."""
    for row, lens in enumerate(lenses):
        whole = f"{title}, {lens}: {what}"
        report.add(whole, 1e3 * statistics.median(times[row]), "ms")
        if row:
            ratio = statistics.median(times[row] / times[0])
            report.add(f"{whole} by that of the pinhole", ratio, "")


def alternating(calls: Sequence[Callable[[], object]], rounds: int) -> NDArray[np.float64]:
    """CPU seconds (calls, rounds) of calls in turn. The first of each is not counted."""
    for call in calls:
        call()
    times = np.empty((len(calls), rounds))
    for turn in range(rounds):
        for row, call in enumerate(calls):
            start = time.process_time()
            call()
            times[row, turn] = time.process_time() - start
    return times


def median(call: Callable[[], object], rounds: int) -> float:
    """CPU seconds of a call, the median over the rounds; the first call is not counted."""
    call()
    times = []
    for _ in range(rounds):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return statistics.median(times)


if __name__ == "__main__":
    main()
