"""Lenses: agreement with OpenCV and COLMAP, sums of areas, bounds, and cost.

Each camera of tests/support/lens_cases.py: pixels of random rays against cv2 and pycolmap, rays of
random pixels there and back, areas of the walls of a turned room, which must add up to the image,
and the longest edges that the quadrature takes to 1e-9 px^2. Then the cost of pixels, rays and
edges, and of counting samples beside the pinhole; medians over the rounds, of one thread.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from rows import Report, arguments  # makes tests/support importable

# isort: split
from lens_cases import (
    BROWN,
    HEIGHT,
    KANNALA,
    PRISM,
    TILTED,
    WIDTH,
    K,
    of_all_kinds,
    pixels,
    rays,
)
from lens_oracles import colmap_pixels, opencv_fisheye_pixels, opencv_pixels
from lens_rooms import on_plane, room

from rastercov import Camera, look_at, open_rasterizer, shapes, sphere_of_poses
from rastercov.lenses import formulas, make_lens
from rastercov.lenses.areas import polygon_areas
from rastercov.lenses.quadrature import edge_table
from rastercov.viewpoints import enclosing_distance

MOST_PX, MOST_RAD, MOST_PX2 = 2e-12, 1e-11, 1e-6


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--rays", type=int, default=4000)
    parser.add_argument("--rounds", type=int, default=9)
    args = parser.parse_args()
    report = Report()
    lenses = of_all_kinds()
    for name, lens in lenses.items():
        add_agreement(report, name, lens, args.rays)
        found = lens.unproject(pixels(args.rays))
        again = lens.unproject(lens.project(found))
        report.add(f"{name}: ray to pixel to ray", np.abs(again - found).max(), "",
                   at_most=MOST_RAD)  # fmt: skip
        total = sum(
            polygon_areas(lens, plane, on_plane(plane, room(3))).inside.sum()
            for plane in lens.planes
        )
        report.add(f"{name}: room less image", abs(total - WIDTH * HEIGHT), "px^2",
                   at_most=MOST_PX2)  # fmt: skip
    report.add("k1 = -0.2, f = 900: folded directions", 100 * folded_share(), "% of those in image")
    for name in ("opencv brown", "opencv prism", "opencv fisheye", "kalibr ds", "backward"):
        plane = lenses[name].planes[0]
        table = edge_table(plane)
        for n in (3, 5, 7, 9, 11):
            length = 2 * table.longest[n] * plane.camera.fx
            report.add(f"{name}: longest edge with n = {n}", length, "px")
    for name in ("opencv brown", "opencv prism", "opencv fisheye", "kalibr ds"):
        add_cost(report, name, lenses[name], args.rounds)
    add_counts(report, args.rounds)
    report.finish(args.json)


def add_agreement(report: Report, name: str, lens: object, n: int) -> None:
    source, _, model = name.partition(" ")
    given = rays(3 * n)
    given = given[np.isfinite(lens.project(given)).all(axis=1)]
    if source == "colmap":
        theirs = colmap_pixels(model, given)
    elif model in ("brown", "prism", "tilted") and source == "opencv":
        distortion = {"brown": BROWN, "prism": PRISM, "tilted": TILTED}[model]
        theirs = opencv_pixels(K, distortion, given)
    elif name == "opencv fisheye":
        matrix = K * [[0.55, 1, 1], [1, 0.55, 1], [1, 1, 1]]
        given = given[given[:, 2] > 0.05]
        theirs = opencv_fisheye_pixels(matrix, KANNALA, given)
    else:
        return
    error = np.nanmax(np.abs(lens.project(given) - theirs))
    report.add(f"{name}: pixels", error, "px", at_most=MOST_PX)


def folded_share() -> float:
    """Share of the directions within 89 degrees with a pixel in the image that are folded there."""
    lens = make_lens("pinhole", WIDTH, HEIGHT, fx=900, fy=900, radial=(-0.2,))
    given = rays(400_000, least_z=np.cos(np.radians(89)))
    u, v = formulas.project(lens.code, lens.params, *given.T)
    is_in = (u >= 0) & (u <= WIDTH) & (v >= 0) & (v <= HEIGHT)
    angle = np.arccos(given[is_in, 2])
    return float((angle > np.arctan(np.sqrt(1 / 0.6))).mean())


def add_cost(report: Report, name: str, lens: object, rounds: int) -> None:
    where = pixels(200_000)
    found = lens.unproject(where)
    plane = lens.planes[0]
    table = edge_table(plane)
    rng = np.random.default_rng(0)
    middle = rng.uniform(-0.5, 0.5, (10_000, 1, 2))
    corners = middle + rng.normal(size=(10_000, 3, 2)) * 5 / plane.camera.fx
    faces = list(corners)
    for what, count, call in (
        ("pixel of a ray", len(found), lambda: lens.project(found)),
        ("ray of a pixel", len(where), lambda: lens.unproject(where)),
        ("edge of 10 px", 30_000, lambda: polygon_areas(lens, plane, faces, table)),
    ):
        report.add(f"{name}: {what}", 1e9 * median(call, rounds) / count, "ns")


def add_counts(report: Report, rounds: int) -> None:
    """CPU time of `count` through lenses, a pose, and by that of the pinhole."""
    size = {"width": WIDTH, "height": HEIGHT}
    pinhole = Camera(**size, fx=900, fy=900)
    cameras = {
        "pinhole": pinhole,
        "brown": replace(pinhole, model="opencv", distortion=BROWN),
        "fisheye": Camera(**size, fx=600, fy=600, model="opencv_fisheye", distortion=KANNALA),
    }
    inside = look_at([(0.2, 0.1, 1.5)] * 4, [(1, 1, 1), (-1, 1, 1), (1, -1, 1.3), (-1, 0.3, 1)])
    for name in ("torus", "teapot", "room"):
        mesh, poses = shapes.by_name(name), inside
        if name != "room":
            centre = mesh.bounds.mean(axis=0)
            poses = sphere_of_poses(centre, enclosing_distance(mesh, pinhole, centre)[1], 4)
        own = 0.0
        for lens, camera in cameras.items():
            with open_rasterizer(mesh, camera, "cpu", threads=1) as rasterizer:
                seconds = median(partial(rasterizer.count, poses, drawn=False), rounds) / 4
            report.add(f"{name}, {lens}: count", 1e3 * seconds, "ms")
            own = own or seconds
            if lens != "pinhole":
                report.add(f"{name}, {lens}: count by that of the pinhole", seconds / own, "")


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
