"""The engine as WebAssembly: in Node it gives the bits of the library of C, and the page's modules
give the figures of `rastercov`. Without Node, `make wasm` or `make lib` these tests are skipped.
"""

import base64
import ctypes
import hashlib
import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from lens_cameras import CAMERAS as LENSES
from nightly import IS_NIGHTLY
from page_in_node import NEEDS_NODE, PAGE
from test_c_border import (
    CAMERA_FIELDS,
    LIBRARY,
    ROOT,
    Camera,
    Figures,
    Gate,
    Library,
    Task,
    scene,
)

import rastercov as rc
from rastercov.core.camera.lenses.planes import planes_in
from rastercov.core.camera.models import MODELS
from rastercov.core.camera.projection import view_border
from rastercov.report.packed_lens import pack_lens

ENGINE, PROVER, READERS = (PAGE / f"{name}.wasm" for name in ("engine", "lens", "readers"))
SHRUNK = ROOT / ".venv/binaryen/node_modules/.bin/wasm-opt"
pytestmark = [
    NEEDS_NODE,
    pytest.mark.skipif(not ENGINE.exists(), reason="no engine.wasm; run: make wasm"),
]
TASK_FIELDS = [name for name, _ in Task._fields_]


CAMERAS = {
    "pinhole": {},
    "brown": {"model": "opencv", "distortion": (-0.11, 0.02, 1e-3, -2e-3)},
    "division": {"model": "division", "distortion": (-0.08,)},
    "omni": {"model": "omni", "distortion": (0.9,)},
}


def camera_of(name, rng):
    """A camera of a kind, whose focal length and centre are drawn."""
    fx, fy, cx, cy = np.array((600, 610, 320, 240)) * rng.uniform(0.95, 1.05, 4)
    return rc.Camera(width=640, height=480, fx=fx, fy=fy, cx=cx, cy=cy, **CAMERAS[name])


def case_of(name, seed, camera):
    """A case for both engines, ready for JSON."""
    rng = np.random.default_rng(seed)
    mesh, poses = scene(seed)
    roles = [each.is_occluder + 2 * each.is_target + 4 * each.is_two_sided for each in mesh.groups]
    spots = rng.integers(0, mesh.n_faces, 40)
    weights = rng.dirichlet((1, 1, 1), 40)
    incidence = float(rng.choice((90, rng.uniform(20, 85))))  # of which circles have chords
    task = {"min_depth": 0.0, "max_depth": None, "max_incidence_deg": incidence}
    task |= dict.fromkeys(("min_pixel_density", "min_facing_density", "min_pixels_per_m2"), 0.0)
    task["min_pixel_density"] = float(rng.choice((0.0, 60.0)))
    return {
        "vertices": mesh.vertices.ravel().tolist(),
        "faces": mesh.faces.ravel().tolist(),
        "roles": [int(roles[group]) for group in mesh.face_group],
        "poses": np.asarray(poses).ravel().tolist(),
        "camera": {each: float(getattr(camera, each)) for each in CAMERA_FIELDS},
        "lens": None if name == "pinhole" else base64.b64encode(pack_lens(camera)).decode(),
        "task": task,
        "gate": {
            "k": int(rng.integers(1, 4)), "needs": [1, 0, 0], "stripes": [0, 1, 0],
            "least_deg": float(rng.choice((0, 20))), "most_deg": float(rng.choice((180, 120))),
            "most_deviation": float(rng.choice((0, 0.02))), "noise": [1e-3, 2e-3, 1e-3],
        },
        "points": (weights[:, :, None] * mesh.vertices[mesh.faces[spots]]).sum(1).ravel().tolist(),
        "spots": spots.tolist(),
        "isRig": bool(rng.random() < 0.5),
    }  # fmt: skip


def digest(*arrays):
    sha256 = hashlib.sha256()
    for each in arrays:
        sha256.update(np.ascontiguousarray(each).tobytes())
    return sha256.hexdigest()


def native_hashes(library, case):
    """The lines of bits.mjs by the library of C."""
    n, n_poses = len(case["roles"]), len(case["poses"]) // 16
    surface = library.make(
        "rc_surface_create", np.array(case["vertices"]), len(case["vertices"]) // 3,
        np.array(case["faces"], np.int32), n, np.array(case["roles"], np.uint8),
    )  # fmt: skip
    solver = library.make("rc_solver_create", surface, 0, 1)
    camera = Camera(ctypes.sizeof(Camera), *case["camera"].values())
    if case["lens"]:
        numbers = np.frombuffer(base64.b64decode(case["lens"]))
        camera.lens = library.make("rc_lens_create", numbers, len(numbers))
    task = Task(
        *(np.inf if case["task"][name] is None else case["task"][name] for name in TASK_FIELDS)
    )
    poses, by, limits = np.array(case["poses"]), ctypes.byref(camera), ctypes.byref(task)
    rule = case["gate"]
    needs, stripes = (np.array(rule[name], np.uint8) for name in ("needs", "stripes"))
    noise = np.array(rule["noise"])
    gate = Gate(rule["k"], needs.ctypes.data, rule["least_deg"], rule["most_deg"],
                rule["most_deviation"], noise.ctypes.data, stripes.ctypes.data)  # fmt: skip
    network, rig = (library.make("rc_network_create", surface, 1) for _ in range(2))
    for made in (network, rig):
        for pose in poses.reshape(n_poses, 16):
            library.call("rc_network_add", made, by, limits, pose)
    library.call("rc_network_join", rig, ctypes.byref(gate), n_poses)
    regions = [library.make("rc_network_regions", network, pose) for pose in range(n_poses)]
    regions.append(library.make("rc_network_regions", rig, 0))
    areas = np.zeros((n_poses + 1, 2, n))
    for own, area in zip(regions, areas, strict=True):
        library.call("rc_regions_areas", own, 0, 1, n, *area)
    union = library.make("rc_network_unite", network, 2)
    views = np.zeros((2, 2, n))
    for level in (1, 2):
        library.call("rc_union_areas", union, level, n, *views[level - 1])
    sums, parts = np.zeros((2, 5)), (np.arange(n) % 3 - 1).astype(np.int32)
    library.call("rc_union_sums", union, n, parts, 2, np.array([1, 2], np.int32), sums)
    zones = library.make(
        "rc_find_zones", rig if case["isRig"] else network, n, np.full(n, 2, np.int32), None, None
    )
    sizes = [ctypes.c_int64() for _ in range(3)]
    library.call("rc_zones_size", zones, *map(ctypes.byref, sizes))
    _, n_parts, n_corners = (each.value for each in sizes)
    parts = [np.zeros(n_parts, np.int32) for _ in range(5)]
    parts += [np.zeros(n_parts), np.zeros(3 * n_corners)]
    places = (ctypes.c_void_p * 7)(*(each.ctypes.data for each in parts))
    library.call("rc_zones_read", zones, n_parts, n_corners, ctypes.byref(places))
    alone = np.zeros(n_poses)
    for pose in range(n_poses):
        library.call("rc_union_alone", union, 1, regions[pose], 0, alone[pose : pose + 1])
    judged = [np.zeros(n, kind) for kind in (np.uint8, *[np.float64] * 3)]
    out = Figures(*(each.ctypes.data for each in judged))
    library.call("rc_judge_faces", solver, by, limits, poses[:16].copy(), n, ctypes.byref(out))
    spots = np.array(case["spots"], np.int32)
    reasons, hiders = np.zeros(len(spots), np.uint8), np.zeros(len(spots), np.int32)
    library.call(
        "rc_judge_points", surface, by, limits, poses[:16].copy(), len(spots),
        np.array(case["points"]), spots,
        ctypes.byref((ctypes.c_void_p * 2)(reasons.ctypes.data, hiders.ctypes.data)),
    )  # fmt: skip
    clear = np.zeros(len(spots), np.uint8)
    places = 1.5 * np.array(case["points"])
    least = ctypes.c_double(0.1)
    library.call("rc_clear_places", surface, len(spots), places, least, clear)
    made = {"zones": [zones], "network": [network, rig], "union": [union], "regions": regions}
    for kind, handles in (made | {"solver": [solver], "surface": [surface]}).items():
        for handle in handles:
            library.call(f"rc_{kind}_free", handle)
    return {
        "regions": digest(areas[:-1]),
        "together": digest(areas[-1]),
        "union": digest(views, sums),
        "zones": digest(*parts[:5]),
        "alone": digest(alone),
        "faces": digest(*judged),
        "points": digest(reasons, hiders),
        "clear": digest(clear),
    }


@pytest.mark.slow
@pytest.mark.skipif(not LIBRARY.exists(), reason="no build/lib; run: make lib")
def test_node_gives_the_bits_of_the_library_of_c(node, tmp_path):
    rng = np.random.default_rng(7)
    cases = []
    for name in CAMERAS:
        camera = camera_of(name, rng)
        cases += [case_of(name, seed, camera) for seed in range(6)]
    (tmp_path / "cases.json").write_text(json.dumps(cases))
    *lines, ended = node("bits.mjs", ENGINE, tmp_path / "cases.json")
    assert sum(each.pop("n_figures") for each in lines) > 100_000
    library = Library()
    for case, line in zip(cases, lines, strict=True):
        assert line == native_hashes(library, case)
    assert ended == {"handles": sum(case["lens"] is not None for case in cases)}


def test_a_page_without_memory_says_a_line_and_goes_on(node, tmp_path):
    path = tmp_path / "cases.json"
    case = case_of("pinhole", 3, camera_of("pinhole", np.random.default_rng(3)))
    path.write_text(json.dumps([case]))
    (said,) = node("limits.mjs", ENGINE, path)
    assert said["line"].startswith("expected enough memory for this rig, got too little;")
    assert said["before"] == said["after"] > 0


def test_the_modules_hold_the_table_of_the_header(node, tmp_path):
    (tmp_path / "cases.json").write_text("[]")
    assert node("bits.mjs", ENGINE, tmp_path / "cases.json") == [{"handles": 0}]
    made = tmp_path / "table.cpp"
    maker, header = ROOT / ".ci/wasm_table", ROOT / "rastercov/engine/include/rastercov.h"
    for module in (ENGINE, PROVER, READERS):
        content = module.read_bytes()
        table = content[content.index(b'{"functions":') :].decode("latin-1")
        own, _ = json.JSONDecoder().raw_decode(table)
        names = list(own["functions"])
        subprocess.run([sys.executable, str(maker), str(header), str(made), *names], check=True)
        text = made.read_text()
        assert own == json.loads(text[text.index("TABLE(") + 6 : text.index(")TABLE")])
        if "rc_task" in own["records"]:
            assert own["records"]["rc_task"]["size"] == ctypes.sizeof(Task)


def optics_of(camera):
    """A camera as `opticsOf` of the page has it."""
    names = ("width", "height", "fx", "fy", "cx", "cy", "skew", "model", "distortion")
    return {name: getattr(camera, name) for name in names} | {
        "max_angle_deg": camera.max_angle_deg or 0
    }


BY_ALGEBRA = ("pinhole", "unified", "double_sphere", "division", "equisolid")
"""Bases whose equations have neither atan nor tan: pages prove their lenses with equal bits."""
DRAWN = {
    "opencv": (*[(-0.3, 0.3)] * 2, *[(-2e-3, 2e-3)] * 2, *[(-0.1, 0.1)] * 4, *[(-1e-3, 1e-3)] * 4,
               *[(-0.05, 0.05)] * 2),
    "division": ((-0.5, 0.3),),
    "omni": ((0.2, 1.5), *[(-0.2, 0.2)] * 2, *[(-2e-3, 2e-3)] * 2),
    "eucm": ((0.3, 0.8), (0.7, 1.3), *[(-0.1, 0.1)] * 2, *[(-2e-3, 2e-3)] * 2),
    "double_sphere": ((-0.3, 0.3), (0.3, 0.7), *[(-0.1, 0.1)] * 2, *[(-2e-3, 2e-3)] * 2),
    "metashape": (*[(-0.2, 0.2)] * 4, *[(-2e-3, 2e-3)] * 2),
    "metashape_equisolid": (*[(-0.1, 0.1)] * 4, *[(-2e-3, 2e-3)] * 2),
}  # fmt: skip
"""Least and greatest coefficients of models that are drawn."""


def proved(node, path, cameras):
    """What `lenses.mjs` says of cameras."""
    path.write_text(json.dumps([optics_of(each) for each in cameras]))
    return zip(cameras, node("lenses.mjs", PROVER, path), strict=True)


def test_lenses_are_proved_in_pages_as_in_python(node, tmp_path):
    cameras = [*LENSES.values(), replace(LENSES["brown"], max_angle_deg=20)]
    for camera, said in proved(node, tmp_path / "cases.json", cameras):
        values, wanted = np.frombuffer(base64.b64decode(said["numbers"])), pack_lens(camera)
        border = np.reshape(said["border"], (-1, 3))
        np.testing.assert_allclose(border, view_border(camera, 8), atol=1e-12)
        if MODELS[camera.model].base in BY_ALGEBRA:
            assert values.tobytes() == wanted.tobytes(), camera.model
            continue
        # The last digits are those of another library of C, and so are places of some lines.
        assert values[:6].tolist() == wanted[:6].tolist()
        for own, other in zip(planes_in(values), planes_in(wanted), strict=True):
            figures = zip((*own.record, *own.slopes), (*other.record, *other.slopes), strict=True)
            assert all(np.allclose(a, b, rtol=1e-6, atol=1e-9) for a, b in figures)
            assert len(own.field.lines) == pytest.approx(len(other.field.lines), rel=0.02)


@pytest.mark.slow
def test_drawn_lenses_have_equal_bits_in_pages(node, tmp_path):
    rng = np.random.default_rng(5)
    cameras = []
    for _ in range(10 if IS_NIGHTLY else 4):
        for model, ranges in DRAWN.items():
            fx, fy, cx, cy = np.array((500, 510, 320, 240)) * rng.uniform(0.9, 1.1, 4)
            terms = tuple(float(rng.uniform(*each)) for each in ranges)
            limit = rng.choice((None, 30.0))
            cameras.append(
                rc.Camera(width=640, height=480, fx=fx, fy=fy, cx=cx, cy=cy, skew=rng.uniform(),
                          model=model, distortion=terms, max_angle_deg=limit)
            )  # fmt: skip
    n_lenses = 0
    for camera, said in proved(node, tmp_path / "cases.json", cameras):
        try:
            wanted = pack_lens(camera).tobytes()
        except rc.CameraError:
            assert said["status"] == 400, camera
            continue
        n_lenses += 1
        assert base64.b64decode(said["numbers"]) == wanted, camera
    assert 2 * n_lenses > len(cameras)


def test_lenses_that_are_none_are_a_line(node, tmp_path):
    good = optics_of(LENSES["brown"])
    cases = [
        {"distortion": [1.0] * 15},
        {"distortion": [1e13]},
        {"model": "none"},
        {"width": 0},
        {"fx": 0},
        {"max_angle_deg": -1},
    ]
    (tmp_path / "cases.json").write_text(json.dumps([good | each for each in cases]))
    for said in node("lenses.mjs", PROVER, tmp_path / "cases.json"):
        assert said["line"].startswith("expected ")
        assert said["status"] == 400


@pytest.mark.skipif(not SHRUNK.exists(), reason="no Binaryen; run with npm: make wasm")
def test_modules_have_at_most_these_bytes():
    sizes = [each.stat().st_size for each in (ENGINE, PROVER, READERS)]
    assert np.less_equal(sizes, (400_000, 125_000, 55_400)).all(), sizes


@pytest.mark.skipif(not SHRUNK.exists(), reason="no Binaryen; run with npm: make wasm")
def test_what_is_committed_is_what_the_source_gives():
    """`make test` compiles the modules anew, in place of those of a checkout."""
    for module in (ENGINE, PROVER, READERS):
        kept = f":{module.relative_to(ROOT).as_posix()}"
        done = subprocess.run(["git", "show", kept], cwd=ROOT, capture_output=True, check=True)
        assert module.read_bytes() == done.stdout, f"add {module.name}, in a commit of its own"
