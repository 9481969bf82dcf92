"""Doubling: the exponent of CPU time and memory by size, of geometry, files and scenes.

Each kind is made in sizes that double. The exponent is that of the last doubling, of a size that
took more than `LEAST_SECONDS`. Of geometry that of the output is beside it: of the corners of what
is seen. What is above that, or above 1, by more than `MOST_ABOVE` is listed as a finding. Each size
runs in a process of its own that is ended after `MOST_SECONDS` of CPU time.
"""

import io
import json
import multiprocessing
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import numpy as np
from doubling_scenes import SCENES
from numpy.typing import NDArray
from rows import Report

import rastercov as rc
from rastercov.cli import main
from rastercov.core.mesh import shapes

Geometry = tuple[NDArray[np.float64], NDArray[np.int64]]
MOST_ABOVE = 0.3
LEAST_SECONDS = 0.5
MOST_SECONDS = 60
MOST_S_A_GROUP = 1e-3
"""CPU seconds of a group of 10,000 with `--table groups`, at most."""
SURE = 4000
"""Size up to which all end in that time: of needles that all cross, the work is their square."""
CAMERA = rc.Camera(width=1280, height=960, fx=1200, fy=1200, cx=640, cy=480)
FIRST, DOUBLINGS = 1000, 5


def soup(corners: NDArray[np.float64]) -> Geometry:
    """Triangles with corners of their own, of (N, 3, 3)."""
    return corners.reshape(-1, 3), np.arange(corners.shape[0] * 3).reshape(-1, 3)


def triangle() -> NDArray[np.float64]:
    return np.array([(-1.0, -0.7, 0.1), (1.1, -0.6, -0.2), (0.1, 0.9, 0.3)])


def moved(n: int, distance: float) -> Geometry:
    noise = np.random.default_rng(n).standard_normal((n, 3, 3))
    return soup(triangle() + distance * noise)


def stack(n: int, gap: float) -> Geometry:
    heights = gap * np.arange(n)[:, None, None] * np.array([0.0, 0.0, 1.0])
    return soup(triangle() + heights)


def fan(n: int, height: float = 0.0, wave: float = 0.0) -> Geometry:
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    rim = np.column_stack((np.cos(angle), np.sin(angle), wave * np.sin(5 * angle)))
    row = np.arange(n)
    faces = np.column_stack((np.zeros(n, int), 1 + row, 1 + (row + 1) % n))
    return np.concatenate(([(0.0, 0.0, height)], rim)), faces


def teeth(n: int, slant: float = 0.0, turned: float = 0.0) -> Geometry:
    """A triangle, and n thin ones along one side of it: T-junctions."""
    x = np.linspace(-1, 1, n + 1)
    zero = np.zeros(n + 1)
    low = np.column_stack((x, zero, zero))
    tips = np.column_stack((x[:-1] + slant, np.full(n, 0.8), np.zeros(n)))
    points = np.concatenate(([(-1, 0, 0), (1, 0, 0), (0, -1, 0)], low, tips))
    c, s = np.cos(turned), np.sin(turned)
    row = np.arange(n)
    thin = np.column_stack((4 + row, 3 + row, 4 + n + row))
    return points @ np.array([(c, s, 0), (-s, c, 0), (0, 0, 1)]), np.vstack(([(0, 1, 2)], thin))


def loose_teeth(n: int) -> Geometry:
    """The same with tips at any depth: about all pairs of them cross where both are seen."""
    points, faces = teeth(n)
    points[4 + n :, 2] = np.random.default_rng(n).uniform(-0.4, 0.4, n)
    return points, faces


def random_soup(n: int, size: float, flat: float = 1.0) -> Geometry:
    random = np.random.default_rng(n)
    centres = random.uniform(-1, 1, (n, 1, 3)) * (1, 1, flat)
    return soup(centres + size * random.standard_normal((n, 3, 3)) * (1, 1, flat))


def grid(n: int, noise: float = 0.0) -> Geometry:
    """Two triangles a cell, with heights of normal noise.

    Very rough ones are slivers, as long as the noise, diagonal, and as thin as a cell. From 8,000
    to 16,000 faces the pairs whose images overlap grow with exponent 1.5, those whose boxes do with
    1.8, so boxes in a grid hardly tell them apart; corners of what is seen grow with 0.8.
    """
    side = max(2, round(np.sqrt(n / 2)))
    x, y = np.meshgrid(np.linspace(-1, 1, side + 1), np.linspace(-1, 1, side + 1))
    z = noise * np.random.default_rng(n).standard_normal(x.size)
    row = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    one = np.column_stack((row, row + 1, row + side + 2))
    other = np.column_stack((row, row + side + 2, row + side + 1))
    return np.column_stack((x.ravel(), y.ravel(), z)), np.concatenate((one, other))


def needles(n: int, turned: float) -> Geometry:
    """Parallel needles beside one another."""
    x = np.linspace(-1, 1, n)
    along = np.array([(0, -0.8, 0), (1 / n, -0.8, 0), (0, 0.8, 0)])
    points, faces = soup(along + np.column_stack((x, 0 * x, 0 * x))[:, None])
    c, s = np.cos(turned), np.sin(turned)
    return points @ np.array([(c, s, 0), (-s, c, 0), (0, 0, 1)]), faces


def crossing(n: int) -> Geometry:
    """Long thin triangles at random angles through one another."""
    random = np.random.default_rng(n)
    ends = random.uniform(-1, 1, (n, 2, 3))
    return soup(np.concatenate((ends, ends[:, :1] + 1e-3 * random.standard_normal((n, 1, 3))), 1))


def spiral(n: int) -> Geometry:
    t = np.linspace(0, 40 * np.pi, n // 2 + 2)
    one = np.column_stack((t * np.cos(t), t * np.sin(t), t)) / t[-1]
    points = np.stack((one, one * (1, 1, 1) + (0, 0, 0.02)), axis=1).reshape(-1, 3)
    row = np.arange(len(points) - 2)
    return points, np.column_stack((row, row + 1, row + 2))


def pages(n: int) -> Geometry:
    """Faces about one edge."""
    angle = np.linspace(0, np.pi, n)
    outer = np.column_stack((np.cos(angle), 0 * angle, np.sin(angle)))
    faces = np.column_stack((np.zeros(n, int), np.ones(n, int), 2 + np.arange(n)))
    return np.concatenate(([(0, -1.0, 0), (0, 1.0, 0)], outer)), faces


def twice(made: Geometry, distance: float) -> Geometry:
    points, faces = made
    noise = distance * np.random.default_rng(1).standard_normal(points.shape)
    return np.concatenate((points, points + noise)), np.concatenate((faces, faces + len(points)))


def of_shape(mesh: rc.Mesh) -> Geometry:
    return mesh.vertices, mesh.faces


GEOMETRIES: dict[str, Callable[[int], Geometry]] = {
    "plane grid": grid,
    "rough grid": lambda n: grid(n, 0.01),
    "very rough grid": lambda n: grid(n, 0.3),
    "torus": lambda n: of_shape(shapes.torus(max(8, round(np.sqrt(n))), max(4, round(n**0.5 / 2)))),
    "flat fan": fan,
    "wavy fan": lambda n: fan(n, wave=0.1),
    "cone": lambda n: fan(n, 1.0),
    "steep cone": lambda n: fan(n, 20.0),
    "T-junctions": teeth,
    "slanted T-junctions": lambda n: teeth(n, 0.5),
    "rotated T-junctions": lambda n: teeth(n, 0.0, 0.6),
    "T-junctions, tips at any depth": loose_teeth,
    "needles": lambda n: needles(n, 0.0),
    "rotated needles": lambda n: needles(n, 0.6),
    "pages of one edge": pages,
    "coincident": lambda n: moved(n, 0.0),
    "moved by 1e-16": lambda n: moved(n, 1e-16),
    "moved by 1e-12": lambda n: moved(n, 1e-12),
    "moved by 1e-10": lambda n: moved(n, 1e-10),
    "moved by 1e-9": lambda n: moved(n, 1e-9),
    "moved by 1e-6": lambda n: moved(n, 1e-6),
    "stack": lambda n: stack(n, 1e-3),
    "fine stack": lambda n: stack(n, 1e-7),
    "small soup": lambda n: random_soup(n, 0.01),
    "soup of n^-1/2": lambda n: random_soup(n, n**-0.5),
    "large soup": lambda n: random_soup(n, 0.1),
    "flat soup": lambda n: random_soup(n, 0.02, 1e-9),
    "crossing needles": crossing,
    "spiral": spiral,
    "grid twice": lambda n: twice(grid(n // 2, 0.01), 0.0),
    "grid twice, float32": lambda n: twice(grid(n // 2, 0.01), 1e-7),
    "grid twice, 1e-10": lambda n: twice(grid(n // 2, 0.01), 1e-10),
    "components": lambda n: soup(
        0.01 * triangle() + np.random.default_rng(n).uniform(-1, 1, (n, 1, 3))
    ),
    "far away": lambda n: (grid(n, 0.01)[0] + 1e6, grid(n, 0.01)[1]),
    "wavy fan, close": lambda n: fan(n, wave=0.1),
    "pages of one edge, close": pages,
    "slanted T-junctions, close": lambda n: teeth(n, 0.5),
    "moved by 1e-12, close": lambda n: moved(n, 1e-12),
    "fine stack, close": lambda n: stack(n, 1e-7),
}
EYES = {
    "wavy fan, close": ((0.05, -0.1, 0.35), (0.0, 0.0, 0.0)),
    "pages of one edge, close": ((-0.29, -0.74, 1.27), (0.11, 0.49, 0.13)),
    "slanted T-junctions, close": ((-0.29, -0.74, 1.27), (0.11, 0.49, 0.13)),
    "moved by 1e-12, close": ((-0.29, -0.74, 1.27), (0.11, 0.49, 0.13)),
    "fine stack, close": ((0.95, 0.94, -0.68), (-0.01, 0.27, -0.08)),
}
"""Eyes, and what they look at, from which the image clips faces; others are before the mesh."""


def _lines_of(points: NDArray[np.float64], faces: NDArray[np.int64]) -> list[str]:
    corners = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in points]
    return corners + [f"f {a} {b} {c}" for a, b, c in faces + 1]


def _obj(n: int, before: str) -> bytes:
    points, faces = soup(np.random.default_rng(n).uniform(-1, 1, (n, 3, 3)))
    lines = _lines_of(points, faces)
    return "\n".join(
        line for row, each in enumerate(lines)
        for line in ([before.format(row), each] if each[0] == "f" and before else [each])
    ).encode()  # fmt: skip


def _stl(n: int, solids: bool) -> bytes:
    facet = ("facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex {0} 1 0\nvertex {0} 0 1\n"
             "endloop\nendfacet\n")  # fmt: skip
    if not solids:
        return (
            "solid a\n" + "".join(facet.format(row) for row in range(n)) + "endsolid a\n"
        ).encode()
    return "".join(f"solid s{k}\n{facet.format(k)}endsolid s{k}\n" for k in range(n)).encode()


def _gltf(n: int, name: str, with_lights: bool) -> bytes:
    import base64

    data = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32).tobytes()
    nodes = [
        {"name": name.format(row), "translation": [row, 0, 0]}
        | ({"extensions": {"KHR_lights_punctual": {"light": row}}} if with_lights else {"mesh": 0})
        for row in range(n)
    ]
    content = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(n))}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                       "min": [0, 0, 0], "max": [1, 1, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
        "buffers": [{"byteLength": len(data), "uri": "data:application/octet-stream;base64,"
                     + base64.b64encode(data).decode()}],
    }  # fmt: skip
    if with_lights:
        lights = [{"type": "point", "name": name.format(row)} for row in range(n)]
        content["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
        content["extensionsUsed"] = ["KHR_lights_punctual"]
    return json.dumps(content).encode()


def _ply(n: int) -> bytes:
    points, faces = soup(np.random.default_rng(n).uniform(-1, 1, (n, 3, 3)))
    header = (f"ply\nformat ascii 1.0\nelement vertex {3 * n}\nproperty float x\nproperty float y\n"
              f"property float z\nelement face {n}\nproperty list uchar int vertex_indices\n"
              "end_header\n")  # fmt: skip
    return (header + "".join("{:g} {:g} {:g}\n".format(*p) for p in points)
            + "".join("3 {} {} {}\n".format(*f) for f in faces)).encode()  # fmt: skip


def _off(n: int) -> bytes:
    points, faces = soup(np.random.default_rng(n).uniform(-1, 1, (n, 3, 3)))
    return (f"OFF\n{3 * n} {n} 0\n" + "".join("{:g} {:g} {:g}\n".format(*p) for p in points)
            + "".join("3 {} {} {}\n".format(*f) for f in faces)).encode()  # fmt: skip


def _lamps(n: int) -> bytes:
    one = '[lamps.lamp{0}]\nkind = "point"\nintensity_cd = 1.0\nposition = [{0}, 0, 0]\n'
    return "".join(one.format(row) for row in range(n)).encode()


def _eyes(n: int) -> list[list[list[float]]]:
    poses: list[list[list[float]]] = rc.sphere_of_poses((0, 0, 0), 3.0, n).tolist()
    return poses


def _poses(n: int) -> bytes:
    return json.dumps({"world_from_camera": _eyes(n)}).encode()


def _transforms(n: int) -> bytes:
    frames = [
        {"file_path": f"{row}.png", "transform_matrix": eye} for row, eye in enumerate(_eyes(n))
    ]
    lens = {"w": 64, "h": 48, "fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24}
    return json.dumps(lens | {"frames": frames}).encode()


def _motion(n: int) -> bytes:
    rows = "".join(f"{row},{row / n},0,0\n" for row in range(n))
    return f"time,mesh.x,mesh.y,mesh.z\n{rows}".encode()


def _chain(n: int) -> bytes:
    """A robot of n links, each on the one before."""
    box = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
    links = "".join(f'<link name="l{row}">{box}</link>' for row in range(n))
    joints = "".join(
        f'<joint name="j{row}" type="continuous"><parent link="l{row}"/><child link="l{row + 1}"/>'
        '<origin xyz="0 0 1"/><axis xyz="1 0 0"/></joint>'
        for row in range(n - 1)
    )
    return f'<robot name="r">{links}{joints}</robot>'.encode()


FILES: dict[str, tuple[str, Callable[[int], bytes]]] = {
    "obj": (".obj", lambda n: _obj(n, "")),
    "obj, objects": (".obj", lambda n: _obj(n, "o part{}")),
    "obj, groups": (".obj", lambda n: _obj(n, "g part{}")),
    "obj, groups of one name": (".obj", lambda n: _obj(n, "g part")),
    "obj, materials": (".obj", lambda n: _obj(n, "usemtl m{}")),
    "obj, smoothing": (".obj", lambda n: _obj(n, "s {}")),
    "obj, comments": (".obj", lambda n: _obj(n, "# {}")),
    "stl": (".stl", lambda n: _stl(n, False)),
    "stl, solids": (".stl", lambda n: _stl(n, True)),
    "ply": (".ply", _ply),
    "off": (".off", _off),
    "gltf, nodes": (".gltf", lambda n: _gltf(n, "node {}", False)),
    "gltf, nodes of one name": (".gltf", lambda n: _gltf(n, "node", False)),
    "gltf, lights": (".lights.gltf", lambda n: _gltf(n, "light {}", True)),
    "gltf, lights of one name": (".lights.gltf", lambda n: _gltf(n, "light", True)),
    "lamps": (".toml", _lamps),
    "poses": (".json", _poses),
    "transforms": (".json", _transforms),
    "motion": (".csv", _motion),
    "robot, a chain": (".urdf", _chain),
}


def _work(kind: str, n: int, how: str, results: Any) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS))
    if how == "command":
        with tempfile.TemporaryDirectory() as folder:
            sys.argv = ["rastercov", *SCENES[kind].command(n, Path(folder))]
            started = time.process_time()
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()) as said:
                try:
                    main()
                except SystemExit as end:
                    if end.code not in (None, 0):
                        results.send(said.getvalue().splitlines()[-1])
                        return
    elif how == "file":
        suffix, content = FILES[kind]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"file{suffix}"
            path.write_bytes(content(n))
            started = time.process_time()
            try:
                READERS.get(suffix, rc.Mesh.load)(path)
            except rc.CameraError as error:  # which is found after all of them are read
                if "1 to 64 points" not in str(error):
                    raise
            except (rc.ConfigError, rc.MeshError) as error:
                results.send(str(error))
                return
    else:
        mesh, pose = scene_of(kind, n)
        started = time.process_time()
        rc.open_observer(mesh, CAMERA, how, threads=1).observe(pose)
    seconds = time.process_time() - started
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    corners = visible_corners(mesh, pose, how)[0] if how in ("certified", "exact") else n
    results.send((seconds, memory, corners))


def scene_of(kind: str, n: int) -> tuple[rc.Mesh, NDArray[np.float64]]:
    points, faces = GEOMETRIES[kind](n)
    centre = points.mean(axis=0)
    eye, middle = EYES.get(kind, (centre + np.array((0.3, -0.4, 3.0)), centre))
    pose = rc.look_at([eye], [middle])
    return rc.Mesh(vertices=points, faces=faces), pose


def visible_corners(mesh: rc.Mesh, pose: NDArray[np.float64], how: str) -> tuple[int, float]:
    """Corners of what is seen, whole faces and pieces of others; CPU seconds of the solver."""
    from rastercov.core.camera.pose import engine_camera, near_limit
    from rastercov.core.exact.surface import surface_of
    from rastercov.engine import solver_parts

    solver = solver_parts.Solver(surface_of(mesh), how == "certified", True)
    near = float(near_limit(CAMERA, mesh.bounds, pose)[0])
    started = time.process_time()
    solver.solve(engine_camera(CAMERA), np.ascontiguousarray(pose[0]), near, False)
    seconds = time.process_time() - started
    visible = np.asarray(solver.visible)
    whole = np.count_nonzero((visible > 0) & (visible == np.asarray(solver.area)))
    return 3 * whole + len(solver.kept[0]), seconds


READERS: dict[str, Callable[[Path], object]] = {
    ".lights.gltf": rc.load_lamps,
    ".toml": rc.load_lamps,
    ".json": rc.read_views,
    ".csv": lambda path: rc.load_motion(shapes.box(), path),
    ".urdf": rc.Robot.load,
}
"""Functions that read files by their suffix; meshes apart."""


LOADED = [
    "rastercov.core.coverage.coverage",
    "rastercov.core.coverage.exact_pass",
    "rastercov.core.mesh.shapes",
]
LOADED += [
    "rastercov.formats.meshes.gltf",
    "rastercov.robots.robot",
    "rastercov.motion.motion_file",
]
LOADED += ["rastercov.formats.cameras", "rastercov.light.lamp_file"]
"""Modules of what is measured, in the process that is forked."""


def measured(kind: str, n: int, how: str) -> tuple[float, int, int] | str | None:
    """CPU seconds, KiB and output of a size, the line that refuses it, or None without an end."""
    context = multiprocessing.get_context("forkserver")  # a fork of what has loaded the package
    context.set_forkserver_preload(LOADED)
    ours, its = context.Pipe()
    process = context.Process(target=_work, args=(kind, n, how, its))
    process.start()
    its.close()
    recv = None
    with suppress(EOFError):
        recv = ours.recv()
    process.join()
    return recv


def at_crossings(report: Report, kind: str, n: int) -> None:
    """CPU seconds of a corner of what is seen of faces that cross, of n and of twice as many."""
    each: list[float] = []
    for size in (n, 2 * n):
        corners, seconds = visible_corners(*scene_of(kind, size), "exact")
        each.append(seconds / corners)
    report.add(f"doubling: {kind}, n = {2 * n}: of a visible corner", each[1], "s")
    report.add(f"doubling: {kind}: by that of n = {n}", each[1] / each[0], "")


def attack(report: Report, effort: float) -> None:
    """Sizes from `FIRST` on, doubled five times; fewer and smaller ones at less effort."""
    doublings = max(1, round(DOUBLINGS + np.log2(min(effort, 1.0))))
    first = FIRST if doublings > 1 else FIRST // 4
    jobs = [(kind, how, first, doublings) for kind in GEOMETRIES for how in ("certified", "exact")]
    jobs += [(kind, "file", first, doublings) for kind in FILES]
    for kind, scene in SCENES.items():
        most = scene.doublings if effort >= 1 else 1
        jobs.append((kind, "command", scene.first, min(scene.doublings, most)))
    steep: list[str] = []
    failed: list[tuple[int, str]] = []
    for kind, how, first, doublings in jobs:
        rows: list[tuple[float, int, int]] = []
        for step in range(doublings + 1):
            measures = measured(kind, first << step, how)
            if isinstance(measures, str):  # a limit of the format, in one line
                print(f"{kind}, n = {first << step}: refused: {measures}", file=sys.stderr)
                break
            if measures is None:
                failed.append((first << step, f"{kind}, {how}, n = {first << step}"))
                break
            rows.append(measures)
        if not rows:
            continue
        seconds = np.array([row[0] for row in rows])
        slope = float(np.log2(seconds[-1] / seconds[-2])) if len(rows) > 1 else float("nan")
        own = float(np.log2(rows[-1][2] / rows[-2][2])) if len(rows) > 1 else float("nan")
        name = f"{kind}, {how}, n = {first << (len(rows) - 1)}"
        report.add(f"doubling: {name}", float(seconds[-1]), "s")
        report.add(f"doubling: {name}: exponent", slope, "")
        if how in ("certified", "exact"):
            report.add(f"doubling: {name}: exponent of the output", own, "")
        report.add(f"doubling: {name}: memory by that of n = {first}", rows[-1][1] / rows[0][1], "")
        if kind == "groups, --table":
            a_group = float(seconds[-1]) / (first << (len(rows) - 1))
            report.add(f"doubling: {kind}: of a group", a_group, "s", at_most=MOST_S_A_GROUP)
        if seconds[-1] > LEAST_SECONDS and slope > max(own, 1.0) + MOST_ABOVE:
            steep.append(f"{name}: {slope:.2f}, its output {own:.2f}, at {seconds[-1]:.2f} s")
    for kind in ("T-junctions, tips at any depth", "crossing needles"):
        at_crossings(report, kind, first)
    print(*(f"{each}: no end" for _, each in failed), *steep, sep="\n", file=sys.stderr)
    report.add("doubling: kinds of geometry", len(GEOMETRIES), "kinds", must=39)
    report.add("doubling: kinds of files", len(FILES), "kinds", must=20)
    report.add("doubling: kinds of scenes", len(SCENES), "kinds", must=14)
    report.add(f"doubling: exponents {MOST_ABOVE} above that of the output", len(steep), "kinds")
    report.add("doubling: sizes that did not end", len(failed), "sizes")
    early = [each for n, each in failed if n <= SURE]
    report.check(f"doubling: each size up to {SURE:,} ends", not early)
